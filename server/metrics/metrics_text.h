// Writes metrics as text, in OpenMetrics 1.0 or in Prometheus' format 0.0.4, which differ in the names of
// counters and the end of the text. prometheus-cpp writes the latter only.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "server/pipeline/capture_statistics.h"

namespace kinevox::metrics {

enum class Format { kOpenMetrics, kPrometheus };

// In the given order; names are [a-z_]+, values any text.
using Labels = std::vector<std::pair<std::string_view, std::string>>;

// One family after the other: family() names it, the samples follow.
class MetricsText {
  public:
    explicit MetricsText(Format format) : format_(format) {}

    // `name` without "_total"; unit in the name, as seconds and bytes.
    void counter(std::string_view name, std::string_view help);
    void gauge(std::string_view name, std::string_view help);
    void histogram(std::string_view name, std::string_view help);

    void sample(double value, const Labels& labels = {});
    void sample(const Histogram& histogram, const Labels& labels = {});

    // One family of one sample.
    void one_counter(std::string_view name, std::string_view help, double value);
    void one_gauge(std::string_view name, std::string_view help, double value);

    std::string take();

  private:
    enum class Kind { kCounter, kGauge, kHistogram };
    void family(Kind kind, std::string_view name, std::string_view help);
    void line(std::string_view suffix, const Labels& labels, double value);

    const Format format_;
    Kind kind_ = Kind::kGauge;
    std::string name_, text_;
};

// The HTTP content type of the format.
std::string_view content_type(Format format);

}  // namespace kinevox::metrics
