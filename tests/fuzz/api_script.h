// What api_fuzzer does to the API: some calls, one after the other, as bytes that libFuzzer keeps and
// changes.
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
    std::string path;  // "/kinevox.v1.CaptureService/Start"
    const google::protobuf::Message* request =
        nullptr;  // an empty one; null for gRPC's own services and what is not there
    bool streams = false;
};

// Every method of kinevox.v1, as linked in; then those of health and reflection, and one that is not there.
const std::vector<Method>& methods();

// In a string: the lease that the fuzzer holds, and the folder that holds all it may touch.
inline constexpr const char* kLeaseWord = "$L";
inline constexpr const char* kRootWord = "$T";

enum class Who : std::uint8_t {
    kAdminister,
    kOperate,
    kExhibit,
    kWatch,
    kNobody,
    kWrongToken,
    kExpired,
    kTwoTokens
};
enum class Ending : std::uint8_t { kRead, kCancelAtOnce, kLeaveOpen, kReadOne };

struct Step {
    std::uint8_t method = 0;  // of methods(), modulo their number
    Who who = Who::kAdminister;
    Ending ending = Ending::kRead;
    int frame_sets = 0;  // that the source gives before: 0 to 3
    std::string request;
    const Method& called() const;
};

inline constexpr std::size_t kMaxSteps = 12;

// Any bytes are a script; what is cut off at the end is left out.
std::vector<Step> read_script(std::span<const std::uint8_t> bytes);
std::string script_bytes(const std::vector<Step>& steps);

// A call of that method with fields filled in as chance wills, most with what could be right.
Step random_step(std::size_t method, std::mt19937& random);
// Changes a field somewhere in it, adds one or takes one away.
void change(google::protobuf::Message& message, std::mt19937& random);

}  // namespace kinevox::fuzz
