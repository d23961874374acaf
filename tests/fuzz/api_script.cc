#include "tests/fuzz/api_script.h"

#include <google/protobuf/descriptor.h>
#include <google/protobuf/message.h>

#include <algorithm>
#include <limits>

#include "kinevox/v1/calibration_service.pb.h"
#include "kinevox/v1/capture_service.pb.h"
#include "kinevox/v1/pose_service.pb.h"
#include "kinevox/v1/recording_service.pb.h"
#include "kinevox/v1/replay_service.pb.h"
#include "kinevox/v1/stream_service.pb.h"

namespace kinevox::fuzz {
namespace {

using google::protobuf::FieldDescriptor;
using google::protobuf::Message;
using google::protobuf::Reflection;

constexpr std::size_t kHead = 4;  // method, flags, length of the request in two bytes, little endian
constexpr const char* kBvh =
    "HIERARCHY\nROOT Hips\n{\nOFFSET 0 0 0\nCHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation "
    "Yrotation\n"
    "End Site\n{\nOFFSET 0 1 0\n}\n}\nMOTION\nFrames: 1\nFrame Time: 0.01\n0 0 0 0 0 0\n";
constexpr const char* kCalibration =
    "[left]\nname = \"left\"\nsize = [64, 48]\nmatrix = [[60, 0, 31.5], [0, 60, 23.5], [0, 0, 1]]\n"
    "distortions = [0, 0, 0, 0]\nrotation = [1.57, 0, 0]\ntranslation = [0, 1, 4]\nfisheye = false\n"
    "[right]\nname = \"right\"\nsize = [64, 48]\nmatrix = [[60, 0, 31.5], [0, 60, 23.5], [0, 0, 1]]\n"
    "distortions = [0, 0, 0, 0]\nrotation = [1.57, 0, 0]\ntranslation = [-0.5, 1, 4]\nfisheye = false\n";
constexpr const char* kTexts[] = {"",
                                  "left",
                                  "right",
                                  "a",
                                  "b",
                                  "seed",
                                  "c1",
                                  "c2",
                                  "x\ny",
                                  "../x",
                                  "../../outside/trial",
                                  "..",
                                  ".",
                                  "$T/escape",
                                  "$T/outside/trial",
                                  "$T/outside/trial/session.toml",
                                  "$T/inside/recordings/seed/session.toml",
                                  "$T/outside/trial/left.mkv",
                                  "$T/outside",
                                  "/dev/zero",
                                  "/dev/stdin",
                                  "/proc/self/environ",
                                  "wand:200:600",
                                  "wand:600",
                                  "checkerboard:4x7:60",
                                  "charuco:4x5:54:40.5:DICT_4X4_1000",
                                  "aprilgrid:6x6:88:26.4",
                                  "knee_angle_r",
                                  "\xc3\xa9\xe2\x82\xac",
                                  "%s%n",
                                  "\x01"};
constexpr std::int64_t kNumbers[] = {0,
                                     1,
                                     -1,
                                     2,
                                     3,
                                     5,
                                     10,
                                     100,
                                     1000,
                                     60'000,
                                     8193,
                                     65'536,
                                     std::numeric_limits<std::int32_t>::max(),
                                     std::numeric_limits<std::int32_t>::min(),
                                     std::numeric_limits<std::int64_t>::max(),
                                     std::numeric_limits<std::int64_t>::min()};
constexpr double kReals[] = {0,
                             0.5,
                             1,
                             1.8,
                             -1,
                             2,
                             30,
                             100,
                             1e-9,
                             1e9,
                             1e300,
                             -1e300,
                             std::numeric_limits<double>::quiet_NaN(),
                             std::numeric_limits<double>::infinity(),
                             -std::numeric_limits<double>::infinity()};

std::size_t below(std::size_t bound, std::mt19937& random) {
    return random() % bound;
}

template <typename T, std::size_t N>
T one_of(const T (&values)[N], std::mt19937& random) {
    return values[below(N, random)];
}

std::string text_for(const FieldDescriptor& field, std::mt19937& random) {
    if (field.name() == "lease_id") return below(16, random) ? kLeasePlaceholder : one_of(kTexts, random);
    if (field.type() == FieldDescriptor::TYPE_BYTES) return one_of({kBvh, kCalibration, ""}, random);
    if (below(64, random) == 0) return std::string(below(5000, random), 'n');
    return one_of(kTexts, random);
}

void fill(Message& message, std::mt19937& random, int depth);

// Sets the field, or appends a value if it is repeated.
void set(Message& message, const FieldDescriptor& field, std::mt19937& random, int depth) {
    const Reflection& r = *message.GetReflection();
    const bool more = field.is_repeated();
    switch (field.cpp_type()) {
        case FieldDescriptor::CPPTYPE_INT32: {
            const auto v = static_cast<std::int32_t>(one_of(kNumbers, random));
            return more ? r.AddInt32(&message, &field, v) : r.SetInt32(&message, &field, v);
        }
        case FieldDescriptor::CPPTYPE_UINT32: {
            const auto v = static_cast<std::uint32_t>(one_of(kNumbers, random));
            return more ? r.AddUInt32(&message, &field, v) : r.SetUInt32(&message, &field, v);
        }
        case FieldDescriptor::CPPTYPE_INT64: {
            const std::int64_t v = one_of(kNumbers, random);
            return more ? r.AddInt64(&message, &field, v) : r.SetInt64(&message, &field, v);
        }
        case FieldDescriptor::CPPTYPE_UINT64: {
            const auto v = static_cast<std::uint64_t>(one_of(kNumbers, random));
            return more ? r.AddUInt64(&message, &field, v) : r.SetUInt64(&message, &field, v);
        }
        case FieldDescriptor::CPPTYPE_DOUBLE: {
            const double v = one_of(kReals, random);
            return more ? r.AddDouble(&message, &field, v) : r.SetDouble(&message, &field, v);
        }
        case FieldDescriptor::CPPTYPE_FLOAT: {
            const auto v = static_cast<float>(one_of(kReals, random));
            return more ? r.AddFloat(&message, &field, v) : r.SetFloat(&message, &field, v);
        }
        case FieldDescriptor::CPPTYPE_BOOL: {
            const bool v = below(2, random);
            return more ? r.AddBool(&message, &field, v) : r.SetBool(&message, &field, v);
        }
        case FieldDescriptor::CPPTYPE_ENUM: {
            const int v = static_cast<int>(
                below(static_cast<std::size_t>(field.enum_type()->value_count()) + 1, random));
            return more ? r.AddEnumValue(&message, &field, v) : r.SetEnumValue(&message, &field, v);
        }
        case FieldDescriptor::CPPTYPE_STRING: {
            std::string v = text_for(field, random);
            return more ? r.AddString(&message, &field, std::move(v))
                        : r.SetString(&message, &field, std::move(v));
        }
        case FieldDescriptor::CPPTYPE_MESSAGE:
            return fill(more ? *r.AddMessage(&message, &field) : *r.MutableMessage(&message, &field), random,
                        depth + 1);
    }
}

void fill(Message& message, std::mt19937& random, int depth) {
    if (depth > 4) return;
    for (int i = 0; i < message.GetDescriptor()->field_count(); ++i) {
        const FieldDescriptor& field = *message.GetDescriptor()->field(i);
        if (field.name() == "lease_id" || below(2, random)) set(message, field, random, depth);
    }
}

const Message* prototype(const google::protobuf::Descriptor* descriptor) {
    return google::protobuf::MessageFactory::generated_factory()->GetPrototype(descriptor);
}

std::vector<Method> all_methods() {
    std::vector<Method> out;
    for (const auto* file :
         {v1::StartCaptureRequest::descriptor()->file(), v1::StreamVolumesRequest::descriptor()->file(),
          v1::ListLibraryPosesRequest::descriptor()->file(), v1::StartProcedureRequest::descriptor()->file(),
          v1::StartRecordingRequest::descriptor()->file(), v1::OpenReplayRequest::descriptor()->file()})
        for (int s = 0; s < file->service_count(); ++s)
            for (int m = 0; m < file->service(s)->method_count(); ++m) {
                const auto* method = file->service(s)->method(m);
                out.push_back({"/" + file->service(s)->full_name() + "/" + method->name(),
                               prototype(method->input_type()), method->server_streaming()});
            }
    out.push_back({"/grpc.health.v1.Health/Check", nullptr, false});
    out.push_back({"/grpc.health.v1.Health/Watch", nullptr, true});
    out.push_back({"/grpc.reflection.v1alpha.ServerReflection/ServerReflectionInfo", nullptr, true});
    out.push_back({"/kinevox.v1.CaptureService/Nothing", nullptr, false});
    return out;
}

}  // namespace

const std::vector<Method>& methods() {
    static const std::vector<Method> kMethods = all_methods();
    return kMethods;
}

const Method& Step::called() const {
    return methods()[method % methods().size()];
}

std::vector<Step> read_script(std::span<const std::uint8_t> bytes) {
    std::vector<Step> steps;
    while (bytes.size() >= kHead && steps.size() < kMaxSteps) {
        const std::uint8_t how = bytes[1];
        const std::size_t length =
            std::min<std::size_t>(bytes[2] + std::size_t{bytes[3]} * 256, bytes.size() - kHead);
        steps.push_back({bytes[0], static_cast<Who>(how & 7), static_cast<Ending>(how >> 3 & 3), how >> 5 & 3,
                         std::string(bytes.begin() + kHead,
                                     bytes.begin() + static_cast<std::ptrdiff_t>(kHead + length))});
        bytes = bytes.subspan(kHead + length);
    }
    return steps;
}

std::string script_bytes(const std::vector<Step>& steps) {
    std::string out;
    for (const Step& step : steps) {
        const std::size_t length = std::min<std::size_t>(step.request.size(), 65'535);
        out += static_cast<char>(step.method);
        out += static_cast<char>(static_cast<int>(step.who) | static_cast<int>(step.ending) << 3 |
                                 step.frame_sets << 5);
        out += static_cast<char>(length % 256);
        out += static_cast<char>(length / 256);
        out += step.request.substr(0, length);
    }
    return out;
}

Step random_step(std::size_t method, std::mt19937& random) {
    Step step;
    step.method = static_cast<std::uint8_t>(method);
    step.who = below(4, random) ? Who::kAdmin : static_cast<Who>(below(8, random));
    step.ending = static_cast<Ending>(below(4, random));
    step.frame_sets = static_cast<int>(below(4, random));
    if (!step.called().request) return step;
    std::unique_ptr<Message> message(step.called().request->New());
    fill(*message, random, 0);
    step.request = message->SerializeAsString();
    return step;
}

void change(Message& message, std::mt19937& random) {
    const auto* const descriptor = message.GetDescriptor();
    if (descriptor->field_count() == 0) return;
    const FieldDescriptor& field = *descriptor->field(
        static_cast<int>(below(static_cast<std::size_t>(descriptor->field_count()), random)));
    const Reflection& r = *message.GetReflection();
    const bool inner = field.cpp_type() == FieldDescriptor::CPPTYPE_MESSAGE;
    if (inner && !field.is_repeated() && r.HasField(message, &field) && below(4, random))
        return change(*r.MutableMessage(&message, &field), random);
    if (inner && field.is_repeated() && r.FieldSize(message, &field) > 0 && below(4, random))
        return change(
            *r.MutableRepeatedMessage(
                &message, &field,
                static_cast<int>(below(static_cast<std::size_t>(r.FieldSize(message, &field)), random))),
            random);
    if (below(5, random) == 0) return r.ClearField(&message, &field);
    set(message, field, random, 0);
}

}  // namespace kinevox::fuzz
