#include "server/metrics/metrics_text.h"

#include <fmt/format.h>

#include <cmath>
#include <iterator>

namespace kinevox::metrics {
namespace {

std::string escaped(std::string_view text, bool quotes) {
    std::string out;
    for (const char c : text) {
        if (c == '\\')
            out += "\\\\";
        else if (c == '\n')
            out += "\\n";
        else if (c == '"' && quotes)
            out += "\\\"";
        else
            out += c;
    }
    return out;
}

std::string number(double value) {
    if (std::isnan(value)) return "NaN";
    if (std::isinf(value)) return value > 0 ? "+Inf" : "-Inf";
    if (value == std::floor(value) && std::abs(value) < 1e15) return fmt::format("{:.0f}", value);
    return fmt::format("{}", value);  // the shortest that reads back the same
}

}  // namespace

void MetricsText::family(Kind kind, std::string_view name, std::string_view help) {
    static constexpr const char* kNames[] = {"counter", "gauge", "histogram"};
    kind_ = kind;
    name_ = name;
    const char* const total = kind == Kind::kCounter && format_ == Format::kPrometheus ? "_total" : "";
    fmt::format_to(std::back_inserter(text_), "# HELP {}{} {}\n# TYPE {}{} {}\n", name, total,
                   escaped(help, format_ == Format::kOpenMetrics), name, total,
                   kNames[static_cast<int>(kind)]);
}

void MetricsText::counter(std::string_view name, std::string_view help) {
    family(Kind::kCounter, name, help);
}
void MetricsText::gauge(std::string_view name, std::string_view help) {
    family(Kind::kGauge, name, help);
}
void MetricsText::histogram(std::string_view name, std::string_view help) {
    family(Kind::kHistogram, name, help);
}

void MetricsText::line(std::string_view suffix, const Labels& labels, double value) {
    text_ += name_;
    text_ += suffix;
    if (!labels.empty()) {
        text_ += '{';
        for (std::size_t i = 0; i < labels.size(); ++i)
            fmt::format_to(std::back_inserter(text_), "{}{}=\"{}\"", i > 0 ? "," : "", labels[i].first,
                           escaped(labels[i].second, true));
        text_ += '}';
    }
    text_ += ' ';
    text_ += number(value);
    text_ += '\n';
}

void MetricsText::sample(double value, const Labels& labels) {
    line(kind_ == Kind::kCounter ? "_total" : "", labels, value);
}

void MetricsText::sample(const Histogram& histogram, const Labels& labels) {
    std::uint64_t below = 0;
    Labels with_bound = labels;
    with_bound.emplace_back("le", "");
    for (std::size_t i = 0; i < histogram.counts.size(); ++i) {
        below += histogram.counts[i];
        with_bound.back().second =
            i < histogram.bounds.size() ? fmt::format("{}", histogram.bounds[i]) : "+Inf";
        line("_bucket", with_bound, static_cast<double>(below));
    }
    line("_sum", labels, histogram.sum);
    line("_count", labels, static_cast<double>(below));
}

void MetricsText::one_counter(std::string_view name, std::string_view help, double value) {
    counter(name, help);
    sample(value);
}

void MetricsText::one_gauge(std::string_view name, std::string_view help, double value) {
    gauge(name, help);
    sample(value);
}

std::string MetricsText::take() {
    if (format_ == Format::kOpenMetrics) text_ += "# EOF\n";
    return std::move(text_);
}

std::string_view content_type(Format format) {
    return format == Format::kOpenMetrics ? "application/openmetrics-text; version=1.0.0; charset=utf-8"
                                          : "text/plain; version=0.0.4; charset=utf-8";
}

}  // namespace kinevox::metrics
