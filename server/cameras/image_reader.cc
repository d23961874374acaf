#include "server/cameras/image_reader.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <system_error>
#include <utility>
#include <vector>

#include "server/cameras/image_file.h"
#include "server/cameras/image_pool.h"

namespace kinevox {
namespace {

namespace fs = std::filesystem;

std::string lower_extension(const fs::path& file) {
    std::string extension = file.extension().string();
    std::transform(extension.begin(), extension.end(), extension.begin(),
                   [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
    return extension;
}

bool is_image_file(const fs::path& file) {
    static constexpr std::array kEndings{".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".pgm", ".ppm"};
    return std::find(kEndings.begin(), kEndings.end(), lower_extension(file)) != kEndings.end();
}

// frame_2.png comes before frame_10.png: runs of digits are compared as numbers.
bool natural_less(const fs::path& a_path, const fs::path& b_path) {
    const std::string a = a_path.string(), b = b_path.string();
    const auto is_digit = [](char c) { return c >= '0' && c <= '9'; };
    std::size_t i = 0, j = 0;
    while (i < a.size() && j < b.size()) {
        if (!is_digit(a[i]) || !is_digit(b[j])) {
            if (a[i] != b[j]) return a[i] < b[j];
            ++i, ++j;
            continue;
        }
        while (i + 1 < a.size() && a[i] == '0' && is_digit(a[i + 1])) ++i;
        while (j + 1 < b.size() && b[j] == '0' && is_digit(b[j + 1])) ++j;
        const std::size_t i0 = i, j0 = j;
        while (i < a.size() && is_digit(a[i])) ++i;
        while (j < b.size() && is_digit(b[j])) ++j;
        if (i - i0 != j - j0) return i - i0 < j - j0;
        if (const int order = a.compare(i0, i - i0, b, j0, j - j0); order != 0) return order < 0;
    }
    return a.size() - i < b.size() - j || (a.size() - i == b.size() - j && a < b);
}

// Converts grey and BGRA, so that the pipeline receives one format.
void copy_as_bgr(const cv::Mat& from, std::uint8_t* to) {
    cv::Mat target(from.rows, from.cols, CV_8UC3, to);
    if (from.channels() == 1)
        cv::cvtColor(from, target, cv::COLOR_GRAY2BGR);
    else if (from.channels() == 4)
        cv::cvtColor(from, target, cv::COLOR_BGRA2BGR);
    else
        from.copyTo(target);
}

class FolderReader final : public ImageReader {
  public:
    FolderReader(std::vector<fs::path> files, const Camera& camera)
        : files_(std::move(files)), camera_(camera), pool_(std::size_t{3} * camera.width * camera.height) {}

    std::int64_t promised() const override { return static_cast<std::int64_t>(files_.size()); }
    bool promise_is_exact() const override { return true; }

    absl::StatusOr<Image> next() override {
        if (at_ >= files_.size()) return absl::OutOfRangeError("the folder has ended");
        const fs::path& file = files_[at_];
        // Ignores the EXIF orientation: the image of a calibrated camera must not be rotated.
        const cv::Mat image = read_image_file(file, cv::IMREAD_COLOR | cv::IMREAD_IGNORE_ORIENTATION);
        if (image.empty())
            return absl::DataLossError(fmt::format(
                "camera {}: {} (image {} of {}) cannot be decoded: it is damaged or not an image; "
                "replace it",
                camera_.name, file.string(), at_ + 1, files_.size()));
        if (image.cols != camera_.width || image.rows != camera_.height)
            return wrong_size(camera_, file, image.cols, image.rows);
        auto data = pool_.take();
        copy_as_bgr(image, data.get());
        ++at_;
        return Image{camera_.width, camera_.height, 3, std::move(data)};
    }

    absl::Status seek(std::int64_t frame) override {
        if (frame < 0 || frame >= promised())
            return absl::OutOfRangeError(fmt::format("camera {}: image {} is out of range; the folder has {}",
                                                     camera_.name, frame, files_.size()));
        at_ = static_cast<std::size_t>(frame);
        return absl::OkStatus();
    }

    absl::Status rewind() override {
        at_ = 0;
        return absl::OkStatus();
    }

  private:
    std::vector<fs::path> files_;
    Camera camera_;
    ImagePool pool_;
    std::size_t at_ = 0;
};

}  // namespace

absl::StatusOr<std::unique_ptr<ImageReader>> open_images(const fs::path& file, const Camera& camera) {
    std::error_code error;
    const fs::file_status status = fs::status(file, error);
    if (!fs::exists(status))
        return absl::NotFoundError(
            fmt::format("camera {}: {} does not exist; correct its path in the session file", camera.name,
                        file.string()));
    std::vector<fs::path> files;
    if (fs::is_directory(status)) {
        for (const auto& entry : fs::directory_iterator(file, error))
            if (is_image_file(entry.path())) files.push_back(entry.path());
        if (error)
            return absl::InvalidArgumentError(fmt::format("camera {}: {} cannot be listed: {}", camera.name,
                                                          file.string(), error.message()));
        if (files.empty())
            return absl::InvalidArgumentError(
                fmt::format("camera {}: folder {} contains no images (png, jpg, bmp, tiff, pgm, ppm)",
                            camera.name, file.string()));
        std::sort(files.begin(), files.end(), natural_less);
    } else if (!fs::is_regular_file(status)) {
        // FFmpeg would block for ever on a pipe without a writer.
        return absl::InvalidArgumentError(
            fmt::format("camera {}: {} is neither a file nor a folder; correct its path in the session file",
                        camera.name, file.string()));
    } else if (is_image_file(file)) {
        files.push_back(file);
    }
    if (RecordedVideo::is_one(file)) return RecordedVideo::open(file, camera);
    if (!files.empty()) return std::make_unique<FolderReader>(std::move(files), camera);
    return open_container_video(file, camera);
}

absl::Status wrong_size(const Camera& camera, const fs::path& file, int width, int height) {
    return absl::InvalidArgumentError(fmt::format(
        "camera {}: {} is {} x {} px, its calibration is for {} x {}; use the calibration of this "
        "recording or rescale one of the two",
        camera.name, file.string(), width, height, camera.width, camera.height));
}

}  // namespace kinevox
