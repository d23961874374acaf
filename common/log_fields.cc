#include "common/log_fields.h"

namespace kinevox {
namespace {

// A line is logged many calls below the place that knows what it is about, on the same thread.
thread_local const LogFields* innermost = nullptr;

}  // namespace

LogFields::LogFields(std::initializer_list<Field> fields) : fields_(fields), outer_(innermost) {
    innermost = this;
}

LogFields::~LogFields() {
    innermost = outer_;
}

std::vector<LogFields::Field> LogFields::now() {
    std::vector<Field> all;
    for (const LogFields* fields = innermost; fields; fields = fields->outer_)
        for (auto field = fields->fields_.rbegin(); field != fields->fields_.rend(); ++field)
            if (!field->second.empty()) all.insert(all.begin(), *field);
    return all;
}

}  // namespace kinevox
