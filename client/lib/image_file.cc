#include <fmt/format.h>
#include <jpeglib.h>
#include <png.h>

#include <csetjmp>
#include <cstdio>
#include <cstring>

#include "client/lib/image.h"
#include "common/files.h"

namespace kinevox::client {
namespace {

constexpr unsigned kMaxEdge = 16384;  // px; more than any camera has, small enough to allocate

struct JpegErrors {
    jpeg_error_mgr manager;  // first: libjpeg knows this struct by its address
    std::jmp_buf escape;
    char message[JMSG_LENGTH_MAX] = "";
};

[[noreturn]] void on_jpeg_error(j_common_ptr info) {
    auto* errors = reinterpret_cast<JpegErrors*>(info->err);
    info->err->format_message(info, errors->message);
    std::longjmp(errors->escape, 1);
}

// Every object that outlives the longjmp belongs to the caller, so none is skipped over.
bool decode_into(std::span<const std::uint8_t> bytes, jpeg_decompress_struct& info, JpegErrors& errors,
                 Image& image) {
    if (setjmp(errors.escape)) return false;
    jpeg_create_decompress(&info);
    jpeg_mem_src(&info, bytes.data(), bytes.size());
    jpeg_read_header(&info, TRUE);
    if (info.image_width > kMaxEdge || info.image_height > kMaxEdge) {
        std::strcpy(errors.message, "the image is too large");
        return false;
    }
    info.out_color_space = info.num_components == 1 ? JCS_GRAYSCALE : JCS_RGB;
    jpeg_start_decompress(&info);
    image.width = static_cast<int>(info.output_width);
    image.height = static_cast<int>(info.output_height);
    image.channels = info.output_components;
    const std::size_t stride =
        std::size_t{info.output_width} * static_cast<std::size_t>(info.output_components);
    image.data.resize(stride * info.output_height);
    while (info.output_scanline < info.output_height) {
        JSAMPROW row = image.data.data() + stride * info.output_scanline;
        jpeg_read_scanlines(&info, &row, 1);
    }
    jpeg_finish_decompress(&info);
    return info.err->num_warnings == 0 || (std::strcpy(errors.message, "the data is damaged"), false);
}

}  // namespace

absl::StatusOr<Image> decode_jpeg(std::span<const std::uint8_t> bytes) {
    Image image;
    JpegErrors errors{};
    jpeg_decompress_struct info{};
    info.err = jpeg_std_error(&errors.manager);
    errors.manager.error_exit = on_jpeg_error;
    errors.manager.output_message = [](j_common_ptr) {};
    const bool ok = decode_into(bytes, info, errors, image);
    jpeg_destroy_decompress(&info);
    if (!ok)
        return absl::InvalidArgumentError(
            fmt::format("{} bytes that should be a JPEG are none: {}", bytes.size(), errors.message));
    return image;
}

absl::Status write_png(const Image& image, const std::filesystem::path& file) {
    png_image png{};
    png.version = PNG_IMAGE_VERSION;
    png.width = static_cast<png_uint_32>(image.width);
    png.height = static_cast<png_uint_32>(image.height);
    png.format = image.channels == 1 ? PNG_FORMAT_GRAY : PNG_FORMAT_RGB;
    png_alloc_size_t size = PNG_IMAGE_PNG_SIZE_MAX(png);
    std::string encoded(size, '\0');
    if (!png_image_write_to_memory(&png, encoded.data(), &size, 0, image.data.data(), 0, nullptr))
        return absl::InternalError(fmt::format("cannot write {}: {}", file.string(), png.message));
    encoded.resize(size);
    return write_file_atomically(file, encoded);
}

}  // namespace kinevox::client
