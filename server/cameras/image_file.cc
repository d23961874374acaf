#include "server/cameras/image_file.h"

#include <opencv2/imgcodecs.hpp>

namespace kinevox {

cv::Mat read_image_file(const std::filesystem::path& file, int flags) {
    try {
        return cv::imread(file.string(), flags);
    } catch (const cv::Exception&) {  // a header that promises an impossible size
        return {};
    }
}

}  // namespace kinevox
