// The input of api_fuzzer: a sequence of calls as bytes that libFuzzer stores and mutates.
#pragma once

#include <cstddef>
#include <cstdint>
#include <random>
#include <span>
#include <string>
#include <vector>

namespace google::protobuf {
class Descriptor;
class Message;
}  // namespace google::protobuf

namespace kinevox::fuzz {

struct Method {
    std::string path;  // "/kinevox.v1.CaptureService/StartCapture"
    const google::protobuf::Message* request =
        nullptr;  // an empty one; null for services of gRPC and unknown methods
    bool streams = false;
};

// Every method of kinevox.v1 that is linked, then those of health and reflection, and an unknown one.
const std::vector<Method>& methods();

// Placeholders in strings: the fuzzer's lease, and the folder with all files that it may access.
inline constexpr const char* kLeasePlaceholder = "$L";
inline constexpr const char* kRootPlaceholder = "$T";

enum class Who : std::uint8_t {
    kAdmin,
    kOperator,
    kDisplay,
    kViewer,
    kNoToken,
    kWrongToken,
    kExpired,
    kTwoTokens
};
enum class Ending : std::uint8_t { kRead, kCancelAtOnce, kLeaveOpen, kReadOne };

struct Step {
    std::uint8_t method = 0;  // of methods(), modulo their number
    Who who = Who::kAdmin;
    Ending ending = Ending::kRead;
    int frame_sets = 0;  // delivered by the source before: 0 to 3
    std::string request;
    const Method& called() const;
};

inline constexpr std::size_t kMaxSteps = 12;

// Any bytes are a script; an incomplete step at the end is dropped.
std::vector<Step> read_script(std::span<const std::uint8_t> bytes);
std::string script_bytes(const std::vector<Step>& steps);

// A call of that method with random fields, most of them plausible.
Step random_step(std::size_t method, std::mt19937& random);
// Changes, adds or removes one field.
void change(google::protobuf::Message& message, std::mt19937& random);

}  // namespace kinevox::fuzz
