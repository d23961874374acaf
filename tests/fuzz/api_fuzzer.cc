// The gRPC handlers over a real connection: calls of every method with any bytes, by every role, in sequence
// or concurrently, cancelled at any point. Each call ends in time with a status that its caller's role
// allows, no file outside the daemon's folder is changed, and the daemon answers afterwards.
#include <google/protobuf/message.h>
#include <google/protobuf/stubs/logging.h>
#include <grpcpp/generic/generic_stub.h>
#include <grpcpp/grpcpp.h>

#include <chrono>
#include <memory>
#include <string>
#include <vector>

#include "kinevox/v1/calibration_service.pb.h"
#include "kinevox/v1/capture_service.pb.h"
#include "tests/fuzz/api_script.h"
#include "tests/fuzz/fuzz_check.h"
#include "tests/fuzz/fuzzed_daemon.h"

extern "C" std::size_t LLVMFuzzerMutate(std::uint8_t* data, std::size_t size, std::size_t max_size);

namespace {

using namespace kinevox::fuzz;
using google::protobuf::FieldDescriptor;
using google::protobuf::Message;

constexpr std::chrono::seconds kMaxCall{20};  // ample, under a sanitizer on a busy machine
constexpr int kMaxRead = 3;                   // messages of a stream

FuzzedDaemon& daemon() {
    static const auto kDaemon = [] {
        google::protobuf::SetLogHandler(nullptr);
        return std::make_unique<FuzzedDaemon>();
    }();
    return *kDaemon;
}

std::string replaced(std::string text, const std::string& word, const std::string& by) {
    for (std::size_t at = text.find(word); at != std::string::npos; at = text.find(word, at + by.size()))
        text.replace(at, word.size(), by);
    return text;
}

// Replaces the placeholders.
void resolve(Message& message, const std::string& lease) {
    std::vector<const FieldDescriptor*> fields;
    const auto& r = *message.GetReflection();
    r.ListFields(message, &fields);
    const auto known = [&](const std::string& text) {
        return replaced(replaced(text, kLeasePlaceholder, lease), kRootPlaceholder, daemon().root().string());
    };
    for (const FieldDescriptor* field : fields) {
        const int count = field->is_repeated() ? r.FieldSize(message, field) : 0;
        if (field->type() == FieldDescriptor::TYPE_STRING) {
            for (int i = 0; i < count; ++i)
                r.SetRepeatedString(&message, field, i, known(r.GetRepeatedString(message, field, i)));
            if (!field->is_repeated()) r.SetString(&message, field, known(r.GetString(message, field)));
        } else if (field->cpp_type() == FieldDescriptor::CPPTYPE_MESSAGE && !field->is_map()) {
            for (int i = 0; i < count; ++i) resolve(*r.MutableRepeatedMessage(&message, field, i), lease);
            if (!field->is_repeated()) resolve(*r.MutableMessage(&message, field), lease);
        }
    }
}

std::string request_of(const Step& step, const std::string& lease) {
    if (!step.called().request) return step.request;
    std::unique_ptr<Message> message(step.called().request->New());
    if (!message->ParseFromString(step.request)) return step.request;  // invalid messages are sent unchanged
    resolve(*message, lease);
    // Another program draws the page, which takes seconds and is tested elsewhere.
    if (auto* certificate = dynamic_cast<kinevox::v1::GetCertificateRequest*>(message.get()))
        certificate->set_include_page(false);
    return message->SerializeAsString();
}

class Call {
  public:
    Call(const Step& step, const std::string& lease) : step_(step) {
        context_.set_deadline(std::chrono::system_clock::now() + kMaxCall);
        if (step.who == Who::kTwoTokens) context_.AddMetadata("authorization", daemon().token(step.who));
        if (const std::string& token = daemon().token(step.who); !token.empty())
            context_.AddMetadata("authorization", token);
        call_ = grpc::GenericStub(daemon().channel()).PrepareCall(&context_, step.called().path, &queue_);
        call_->StartCall(this);
        running_ = wait();
        if (!running_) return;
        const grpc::Slice slice(request_of(step, lease));
        call_->WriteLast(grpc::ByteBuffer(&slice, 1), {}, this);
        if (step.ending == Ending::kCancelAtOnce) context_.TryCancel();
        running_ = wait();
    }

    // Reads the messages that the step requests, ends the call and checks its status.
    void end() {
        const bool all = step_.ending == Ending::kRead && !step_.called().streams;
        for (int i = 0; running_ && i < (all ? 1 : kMaxRead); ++i) {
            if (step_.called().streams && !may_wait(i)) context_.TryCancel();
            call_->Read(&answer_, this);
            running_ = wait();
        }
        if (step_.called().streams) context_.TryCancel();
        grpc::Status status;
        call_->Finish(&status, this);
        wait();
        queue_.Shutdown();
        for (void* tag = nullptr; queue_.Next(&tag, &ignored_);) {
        }
        check(status);
    }

  private:
    // Streams of states send a first message at once; others wait for frame sets or events that may never
    // arrive.
    bool may_wait(int messages) const {
        const std::string& path = step_.called().path;
        return step_.ending == Ending::kReadOne && messages == 0 &&
               path.find("/Watch") != std::string::npos && !path.ends_with("/WatchEvents");
    }

    bool wait() {
        void* tag = nullptr;
        bool ok = false;
        FUZZ_CHECK(queue_.Next(&tag, &ok));
        return ok;
    }

    void check(const grpc::Status& status) const {
        // If the daemon detects the deadline first, the status is CANCELLED.
        FUZZ_CHECK(step_.ending == Ending::kLeaveOpen ||
                   std::chrono::system_clock::now() < context_.deadline());
        FUZZ_CHECK(status.error_code() != grpc::StatusCode::DEADLINE_EXCEEDED);
        FUZZ_CHECK(status.error_code() != grpc::StatusCode::UNKNOWN);
        FUZZ_CHECK(status.error_message().find('\n') == std::string::npos);
        if (!status.ok()) return;
        // A cancelled call may end before its caller is identified.
        const std::string& path = step_.called().path;
        FUZZ_CHECK(daemon().may(step_.who, path));
    }

    const Step step_;
    grpc::ClientContext context_;
    grpc::CompletionQueue queue_;
    std::unique_ptr<grpc::GenericClientAsyncReaderWriter> call_;
    grpc::ByteBuffer answer_;
    bool running_ = false, ignored_ = false;
};

// An authorised call, afterwards.
void check_answers() {
    grpc::GenericStub stub(daemon().channel());
    Step step;
    for (std::size_t m = 0; m < methods().size(); ++m)
        if (methods()[m].path == "/kinevox.v1.CaptureService/GetStatus")
            step.method = static_cast<std::uint8_t>(m);
    Call call(step, "");
    call.end();
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    const std::vector<Step> steps = read_script({data, size});
    if (steps.empty()) return 0;
    const std::string lease = daemon().acquire_control();
    std::vector<std::unique_ptr<Call>> open;
    for (const Step& step : steps) {
        daemon().give(step.frame_sets);
        auto call = std::make_unique<Call>(step, lease);
        if (step.ending == Ending::kLeaveOpen)
            open.push_back(std::move(call));
        else
            call->end();
    }
    for (const auto& call : open) call->end();
    check_answers();
    daemon().reset();
    return 0;
}

extern "C" std::size_t LLVMFuzzerCustomMutator(std::uint8_t* data, std::size_t size, std::size_t max_size,
                                               unsigned seed) {
    std::mt19937 random(seed);
    std::vector<Step> steps = read_script({data, size});
    const auto any = [&] { return random() % steps.size(); };
    const unsigned mutation = random() % 8;
    if (steps.empty() || (mutation == 0 && steps.size() < kMaxSteps)) {
        const auto at =
            steps.begin() + static_cast<std::ptrdiff_t>(steps.empty() ? 0 : random() % (steps.size() + 1));
        steps.insert(at, random_step(random() % methods().size(), random));
    } else if (mutation == 1 && steps.size() > 1) {
        steps.erase(steps.begin() + static_cast<std::ptrdiff_t>(any()));
    } else if (mutation == 2) {
        std::swap(steps[any()], steps[any()]);
    } else if (mutation == 3) {
        Step& step = steps[any()];
        const Step other = random_step(step.method, random);
        step.who = other.who, step.ending = other.ending, step.frame_sets = other.frame_sets;
    } else if (mutation == 4) {  // arbitrary bytes
        std::string& request = steps[any()].request;
        std::string bytes = request;
        bytes.resize(std::min<std::size_t>(request.size() + 64, 60'000));
        bytes.resize(LLVMFuzzerMutate(reinterpret_cast<std::uint8_t*>(bytes.data()),
                                      std::min(request.size(), bytes.size()), bytes.size()));
        request = bytes;
    } else {
        Step& step = steps[any()];
        if (!step.called().request) return LLVMFuzzerMutate(data, size, max_size);
        std::unique_ptr<Message> message(step.called().request->New());
        message->ParsePartialFromString(step.request);
        change(*message, random);
        step.request = message->SerializePartialAsString();
    }
    const std::string bytes = script_bytes(steps);
    if (bytes.size() > max_size) return LLVMFuzzerMutate(data, size, max_size);
    std::copy(bytes.begin(), bytes.end(), data);
    return bytes.size();
}
