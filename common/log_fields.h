// Fields of a log line for programs: the journal stores them with the message.
#pragma once

#include <initializer_list>
#include <string>
#include <utility>
#include <vector>

namespace kinevox {

// Added to the lines that its thread logs during its lifetime; nested ones accumulate, innermost last. Names
// are upper-case letters, digits and _, as the journal requires: KINEVOX_EVENT, KINEVOX_CAMERA, ...
// (docs/admin.md).
class LogFields {
  public:
    using Field = std::pair<std::string, std::string>;  // name, value

    LogFields(std::initializer_list<Field> fields);
    ~LogFields();
    LogFields(const LogFields&) = delete;
    LogFields& operator=(const LogFields&) = delete;

    // The current ones of the calling thread, without empty ones.
    static std::vector<Field> now();

  private:
    std::vector<Field> fields_;
    const LogFields* outer_;
};

}  // namespace kinevox
