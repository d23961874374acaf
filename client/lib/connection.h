// The channel to a daemon, its errors in words, and reading a stream.
#pragma once

#include <absl/status/status.h>
#include <grpcpp/grpcpp.h>

#include <algorithm>
#include <condition_variable>
#include <memory>
#include <mutex>
#include <type_traits>

#include "client/lib/client.h"

namespace kinevox::client {

// Connects when it is first used, and reconnects automatically.
std::shared_ptr<grpc::Channel> connect(const ClientOptions& options);

// Adds what goes with every call: the token.
void prepare_context(grpc::ClientContext& context, const ClientOptions& options);

// The status of a call that this client did not cancel itself; connection errors name the address, and TLS
// where the two sides do not match in it.
absl::Status to_absl(const grpc::Status& status, const ClientOptions& options);

// Reads a stream on the calling thread, with an idle timeout, a stop token and reconnection.
// read_stream_once: over one connection. `prepare(context, queue)` returns a ClientAsyncReader<Message>.
// `on_message` returns whether to continue, or an error, which ends the stream with it.
template <typename Message, typename Prepare>
absl::Status read_stream_once(const Prepare& prepare,
                              const std::function<absl::StatusOr<bool>(const Message&)>& on_message,
                              const StreamOptions& options, const ClientOptions& client, bool& any_message) {
    grpc::ClientContext context;
    prepare_context(context, client);
    context.set_wait_for_ready(false);
    grpc::CompletionQueue queue;
    const std::stop_callback cancel(options.stop, [&] { context.TryCancel(); });
    const auto reader = prepare(&context, &queue);

    // Waits for the operation in flight. False: it failed, the stream is over.
    bool idle = false;
    const auto wait = [&] {
        void* tag = nullptr;
        bool ok = false;
        const bool limited = options.idle_timeout.count() > 0 && !idle;
        const auto deadline = limited ? std::chrono::system_clock::now() + options.idle_timeout
                                      : std::chrono::system_clock::time_point::max();
        while (queue.AsyncNext(&tag, &ok, deadline) == grpc::CompletionQueue::TIMEOUT) {
            idle = true;
            context.TryCancel();
            queue.Next(&tag, &ok);
            return false;
        }
        return ok;
    };
    absl::Status ended;
    bool leaving = false;
    reader->StartCall(nullptr);
    if (wait()) {
        Message message;
        for (;;) {
            reader->Read(&message, nullptr);
            if (!wait()) break;
            any_message = true;
            const absl::StatusOr<bool> proceed = on_message(message);
            if (proceed.ok() && *proceed) continue;
            ended = proceed.status();
            leaving = true;
            context.TryCancel();
            break;
        }
    }
    grpc::Status status;
    reader->Finish(&status, nullptr);
    void* tag = nullptr;
    bool ok = false;
    queue.Next(&tag, &ok);
    queue.Shutdown();
    while (queue.Next(&tag, &ok)) {
    }
    if (leaving) return ended;
    if (options.stop.stop_requested()) return absl::CancelledError("stopped");
    if (idle)
        return absl::DeadlineExceededError("no message from " + client.server + " for " +
                                           std::to_string(options.idle_timeout.count() / 1000) +
                                           " s; see with `kinevox status` whether the capture runs");
    return to_absl(status, client);
}

template <typename Message, typename Prepare>
absl::Status read_stream(const Prepare& prepare,
                         const std::function<absl::StatusOr<bool>(const Message&)>& on_message,
                         const StreamOptions& options, const ClientOptions& client) {
    constexpr std::chrono::milliseconds kFirstPause{200}, kMaxPause{5'000};
    auto pause = kFirstPause;
    for (;;) {
        bool any_message = false;
        absl::Status status = read_stream_once<Message>(prepare, on_message, options, client, any_message);
        if (!options.reconnect || !absl::IsUnavailable(status)) return status;
        if (options.on_reconnect) options.on_reconnect(status);
        if (any_message) pause = kFirstPause;
        std::mutex mutex;
        std::condition_variable_any stopped;
        std::unique_lock lock(mutex);
        stopped.wait_for(lock, options.stop, pause, [] { return false; });
        if (options.stop.stop_requested()) return absl::CancelledError("stopped");
        pause = std::min(2 * pause, kMaxPause);
    }
}

}  // namespace kinevox::client
