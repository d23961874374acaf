// What a line of the log is about, for programs: the journal keeps it as fields beside the message.
#pragma once

#include <initializer_list>
#include <string>
#include <utility>
#include <vector>

namespace kinevox {

// Belongs to the lines that its thread logs as long as it lives; those of several are added up, innermost
// last. Names are upper-case letters, digits and _, as the journal wants them: KINEVOX_EVENT, KINEVOX_CAMERA,
// ... (docs/admin.md).
class LogFields {
  public:
    using Field = std::pair<std::string, std::string>;  // name, value

    LogFields(std::initializer_list<Field> fields);
    ~LogFields();
    LogFields(const LogFields&) = delete;
    LogFields& operator=(const LogFields&) = delete;

    // Of the calling thread, now; those without a value are left out.
    static std::vector<Field> now();

  private:
    std::vector<Field> fields_;
    const LogFields* outer_;
};

}  // namespace kinevox
