#include "tests/support/fake_gige/scene.h"

#include <algorithm>

#include "common/session_file.h"
#include "server/cameras/image_reader.h"

namespace kinevox::testing {
namespace {

absl::StatusOr<std::vector<Image>> read_some(const std::filesystem::path& file, const Camera& camera,
                                             std::size_t most) {
    auto reader = open_images(file, camera);
    if (!reader.ok()) return reader.status();
    std::vector<Image> images;
    while (images.size() < most) {
        auto image = (*reader)->next();
        if (absl::IsOutOfRange(image.status())) break;
        if (!image.ok()) return image.status();
        images.push_back(std::move(*image));
    }
    return images;
}

// Which of B G R a sensor of GenICam's pattern has at a pixel.
int channel_at(std::uint32_t format, int x, int y) {
    constexpr int kBlue = 0, kGreen = 1, kRed = 2;
    const bool gb_first = (format & 0xff) == 0x0a;  // BayerGB: G B / R G; otherwise BayerRG: R G / G B
    if (gb_first) return (x + y) % 2 == 0 ? kGreen : y % 2 == 0 ? kBlue : kRed;
    return (x + y) % 2 == 1 ? kGreen : y % 2 == 0 ? kRed : kBlue;
}

Bytes coded(const Image& image, const Registers& registers) {
    const std::uint32_t format = registers.get(reg::kPixelFormat);
    const int width = static_cast<int>(registers.get(reg::kWidth)),
              height = static_cast<int>(registers.get(reg::kHeight));
    const int bits = registers.bits_per_pixel();
    auto out = std::make_shared<std::vector<std::uint8_t>>();
    out->reserve(static_cast<std::size_t>(width) * height * bits / 8);
    for (int y = 0; y < height; ++y)
        for (int x = 0; x < width; ++x) {
            static constexpr std::uint8_t kBlack[3] = {0, 0, 0};
            const std::uint8_t* bgr =
                x < image.width && y < image.height
                    ? image.data.get() + 3 * (static_cast<std::size_t>(y) * image.width + x)
                    : kBlack;
            const std::uint8_t raw = bgr[channel_at(format, x, y)];
            if (format == 0x02180015)
                out->insert(out->end(), bgr, bgr + 3);
            else if (format == 0x02180014)
                out->insert(out->end(), {bgr[2], bgr[1], bgr[0]});
            else if (format == 0x01080001)
                out->push_back(static_cast<std::uint8_t>((bgr[0] + 2 * bgr[1] + bgr[2]) / 4));
            else if (bits == 8)
                out->push_back(raw);
            else if (bits == 16) {  // 10 or 12 bits in the low ones
                const int value = raw << (format == 0x0110000d ? 2 : 4);
                out->push_back(static_cast<std::uint8_t>(value));
                out->push_back(static_cast<std::uint8_t>(value >> 8));
            } else if (x % 2 == 0) {  // BayerRG12p: the low bits are 0
                out->push_back(static_cast<std::uint8_t>(raw << 4));
                out->push_back(static_cast<std::uint8_t>(raw >> 4));
                out->push_back(0);
            } else {
                out->back() = raw;
            }
        }
    return out;
}

}  // namespace

std::vector<std::uint8_t> pattern_image(std::uint64_t number, std::size_t bytes) {
    std::vector<std::uint8_t> out(bytes);
    std::uint32_t state = static_cast<std::uint32_t>(number) * 2654435761u + 12345;
    for (std::size_t i = 0; i < bytes; ++i) {
        state = state * 1664525u + 1013904223u;
        out[i] = static_cast<std::uint8_t>(state >> 24);
    }
    for (std::size_t i = 0; i < std::min<std::size_t>(8, bytes); ++i)
        out[i] = static_cast<std::uint8_t>(number >> 8 * i);
    return out;
}

absl::StatusOr<Scene> Scene::open(const std::filesystem::path& file, const std::string& name,
                                  std::size_t most) {
    auto session = read_session(file);
    if (!session.ok()) return session.status();
    auto cameras = read_session_cameras(*session);
    if (!cameras.ok()) return cameras.status();
    for (std::size_t c = 0; c < cameras->size(); ++c) {
        if ((*cameras)[c].name != name) continue;
        Scene scene;
        auto images = read_some(session->cameras[c].video, (*cameras)[c], most);
        if (!images.ok()) return images.status();
        scene.images_ = *std::move(images);
        if (!session->cameras[c].background.empty()) {
            auto empty = read_some(session->cameras[c].background, (*cameras)[c], most);
            if (!empty.ok()) return empty.status();
            scene.empty_ = *std::move(empty);
        }
        return scene;
    }
    return absl::NotFoundError(file.string() + ": has no camera '" + name + "'");
}

Bytes Scene::image(std::uint64_t frame, bool empty_scene, const Registers& registers) {
    if (is_pattern())
        return std::make_shared<std::vector<std::uint8_t>>(
            pattern_image(frame, registers.get(reg::kPayloadSize)));
    if (const std::uint32_t format = registers.get(reg::kPixelFormat); format != format_) {
        format_ = format;
        coded_.assign(images_.size(), nullptr);
        coded_empty_.assign(empty_.size(), nullptr);
    }
    const bool empty = empty_scene && !empty_.empty();
    const std::size_t at = frame % (empty ? empty_ : images_).size();
    Bytes& bytes = (empty ? coded_empty_ : coded_)[at];
    if (!bytes || bytes->size() != registers.get(reg::kPayloadSize))
        bytes = coded((empty ? empty_ : images_)[at], registers);
    return bytes;
}

}  // namespace kinevox::testing
