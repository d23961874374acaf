#pragma once

#include <filesystem>
#include <opencv2/core.hpp>

namespace kinevox {

// An image as cv::imread() returns it; empty if it cannot be decoded. `flags`: cv::ImreadModes.
cv::Mat read_image_file(const std::filesystem::path& file, int flags);

}  // namespace kinevox
