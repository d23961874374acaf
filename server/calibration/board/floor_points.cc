#include <absl/strings/ascii.h>
#include <absl/strings/numbers.h>
#include <absl/strings/str_split.h>
#include <fmt/format.h>

#include <cmath>
#include <string>

#include "common/files.h"
#include "common/one_line.h"
#include "server/calibration/board/floor.h"

namespace kinevox {
namespace {

constexpr double kFar_m = 1000;

bool read_numbers(std::string_view text, std::vector<double>& numbers) {
    for (const absl::string_view part : absl::StrSplit(absl::string_view(text.data(), text.size()), ',')) {
        double value = 0;
        if (!absl::SimpleAtod(part, &value) || !std::isfinite(value)) return false;
        numbers.push_back(value);
    }
    return true;
}

}  // namespace

absl::StatusOr<FloorPoint> parse_floor_point(std::string_view text, const std::vector<Camera>& cameras) {
    const auto wrong = [&](const std::string& what) {
        return absl::InvalidArgumentError(fmt::format(
            "point '{}': {}; write '0,0,0 cam1:412.5,300 cam3:99,120', metres, then pixels of each click",
            one_line(std::string(text.substr(0, 100))), what));
    };
    FloorPoint point;
    bool first = true;
    for (const absl::string_view part : absl::StrSplit(absl::string_view(text.data(), text.size()),
                                                       absl::ByAnyChar(" \t\r"), absl::SkipEmpty())) {
        const std::string_view word(part.data(), part.size());
        std::vector<double> numbers;
        const std::size_t colon = word.rfind(':');
        if (colon == std::string_view::npos) {
            if (!first || !read_numbers(word, numbers) || numbers.size() != 3 ||
                std::abs(numbers[0]) > kFar_m || std::abs(numbers[1]) > kFar_m ||
                std::abs(numbers[2]) > kFar_m)
                return wrong(
                    fmt::format("'{}' is neither X,Y,Z in metres nor CAMERA:U,V", word.substr(0, 40)));
            point.in_world = {numbers[0], numbers[1], numbers[2]};
        } else {
            const std::string_view name = word.substr(0, colon);
            const Camera* const camera = camera_named(cameras, name);
            if (!camera) return wrong(fmt::format("the calibration has no camera '{}'", name.substr(0, 40)));
            if (!read_numbers(word.substr(colon + 1), numbers) || numbers.size() != 2)
                return wrong(fmt::format("'{}' is not a pixel such as 412.5,300",
                                         word.substr(colon + 1).substr(0, 40)));
            if (!(numbers[0] >= -0.5 && numbers[1] >= -0.5 && numbers[0] <= camera->width - 0.5 &&
                  numbers[1] <= camera->height - 0.5))
                return wrong(fmt::format("{:g},{:g} is outside camera {}'s image of {} x {} px", numbers[0],
                                         numbers[1], camera->name, camera->width, camera->height));
            const int index = static_cast<int>(camera - cameras.data());
            for (const auto& [other, pixel] : point.clicks)
                if (other == index) return wrong(fmt::format("camera {} is given twice", camera->name));
            point.clicks.push_back({index, {numbers[0], numbers[1]}});
        }
        first = false;
    }
    if (point.clicks.empty()) return wrong("no click is given");
    return point;
}

absl::StatusOr<std::vector<FloorPoint>> read_floor_points(const std::filesystem::path& file,
                                                          const std::vector<Camera>& cameras) {
    const auto text = read_file(file, 1 << 20);
    if (!text.ok()) return text.status();
    std::vector<FloorPoint> points;
    int number = 0;
    for (absl::string_view line : absl::StrSplit(*text, '\n')) {
        ++number;
        line = absl::StripAsciiWhitespace(line.substr(0, line.find('#')));
        if (line.empty()) continue;
        auto point = parse_floor_point({line.data(), line.size()}, cameras);
        if (!point.ok())
            return absl::InvalidArgumentError(
                fmt::format("{}:{}: {}", file.string(), number, std::string(point.status().message())));
        points.push_back(*std::move(point));
    }
    return points;
}

}  // namespace kinevox
