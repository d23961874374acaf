// The gRPC side of one subscriber: one write in flight, the next message is fetched when it completes.
//
// All events are handled on a strand of the encoders: messages in the mailbox, completed writes,
// cancellation, the rate timer. The pipeline's and gRPC's threads only post to it, so the state below needs
// no lock.
#pragma once

#include <grpcpp/support/server_callback.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <atomic>
#include <boost/asio/post.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/asio/strand.hpp>
#include <chrono>
#include <exception>
#include <functional>
#include <memory>
#include <optional>
#include <utility>

#include "server/access/guard.h"
#include "server/api/api_context.h"
#include "server/api/call.h"
#include "server/api/subscribers.h"
#include "server/api/to_proto.h"

namespace kinevox {

struct StreamPace {
    double max_rate_hz = 0;    // 0: no limit
    bool latest_only = false;  // limited by the fair share of the daemon's messages
};

// `Box` is a Mailbox. The reactor owns itself from run() to gRPC's OnDone.
template <typename Box, typename Message>
class StreamReactor final : public grpc::ServerWriteReactor<Message>,
                            public std::enable_shared_from_this<StreamReactor<Box, Message>> {
  public:
    // Makes the message to send. May take long.
    using Translate = std::function<Message(const typename Box::Taken&)>;
    using Subscribe = std::function<std::shared_ptr<Box>(std::function<void()> on_ready)>;

    static StreamReactor* run(const ApiContext& api, grpc::CallbackServerContext* context,
                              const StreamPace& pace, const Subscribe& subscribe, Translate translate) {
        auto reactor =
            std::shared_ptr<StreamReactor>(new StreamReactor(api, pace.max_rate_hz, std::move(translate)));
        reactor->self_ = reactor;
        if (api.streams.fair_share && pace.latest_only) reactor->slot_.emplace(*api.streams.fair_share);
        if (const absl::Status counted = reactor->be_counted(api, context); !counted.ok()) {
            reactor->finish_at_once(to_grpc(counted));
            return reactor.get();
        }
        boost::asio::post(reactor->strand_, [reactor, subscribe] {
            if (reactor->finished_) return;  // ended by the guard before
            reactor->box_ = subscribe([weak = reactor->weak_from_this()] {
                if (const auto alive = weak.lock()) alive->wake();
            });
            reactor->StartSendInitialMetadata();  // confirms the subscription to the client
            reactor->advance();
        });
        return reactor.get();
    }

    // Ends the call with a status.
    static StreamReactor* refuse(const ApiContext& api, const grpc::Status& why) {
        auto reactor = std::shared_ptr<StreamReactor>(new StreamReactor(api, 0, {}));
        reactor->self_ = reactor;
        reactor->finish_at_once(why);
        return reactor.get();
    }

    void OnWriteDone(bool ok) override {
        boost::asio::post(strand_, [self = this->shared_from_this(), ok] {
            self->writing_ = false;
            if (!ok) self->cancelled_ = true;
            self->advance();
        });
    }

    void OnCancel() override {
        boost::asio::post(strand_, [self = this->shared_from_this()] {
            self->cancelled_ = true;
            self->advance();
        });
    }

    void OnDone() override {
        // The strand may still hold a task of this reactor: it ends when the last of them is gone.
        boost::asio::post(strand_, [self = std::exchange(self_, nullptr)] {
            self->finished_ = true;
            self->timer_.cancel();
            self->box_.reset();
            self->counted_.reset();
            self->slot_.reset();
        });
    }

  private:
    using Clock = std::chrono::steady_clock;

    StreamReactor(const ApiContext& api, double max_rate_hz, Translate translate)
        : strand_(boost::asio::make_strand(api.threads.encoders)),
          timer_(api.threads.timers),
          translate_(std::move(translate)) {
        if (max_rate_hz > 0)
            period_ =
                std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(1 / max_rate_hz));
    }

    absl::Status be_counted(const ApiContext& api, grpc::CallbackServerContext* context) {
        if (!api.guard) return absl::OkStatus();
        auto on_end = [weak = this->weak_from_this(), context](const absl::Status& why) {
            const auto self = weak.lock();
            if (self) boost::asio::post(self->strand_, [self, context, why] { self->end(context, why); });
        };
        auto counted = api.guard->open_stream(authorization_of(*context), std::move(on_end));
        if (!counted.ok()) return counted.status();
        counted_ = *std::move(counted);
        return absl::OkStatus();
    }

    // The context lives until OnDone, which follows finish(). A pending write is cancelled.
    void end(grpc::CallbackServerContext* context, const absl::Status& why) {
        if (finished_) return;
        ended_ = why;
        if (writing_) context->TryCancel();
        advance();
    }

    // Any thread.
    void wake() {
        if (woken_.exchange(true)) return;  // its task is pending
        boost::asio::post(strand_, [self = this->shared_from_this()] {
            self->woken_ = false;
            self->advance();
        });
    }

    // Before gRPC has the reactor. A client that leaves meanwhile must not end the call once more.
    void finish_at_once(const grpc::Status& status) {
        finished_ = true;
        this->Finish(status);
    }

    void finish(const grpc::Status& status) {
        finished_ = true;
        timer_.cancel();
        box_.reset();  // frees queued messages now, not at OnDone
        counted_.reset();
        slot_.reset();
        this->Finish(status);
    }

    void advance() {
        if (finished_ || writing_) return;
        if (!ended_.ok()) return finish(to_grpc(ended_));
        if (cancelled_) return finish({grpc::StatusCode::CANCELLED, "the client left"});
        const absl::Status status = box_->status();
        if (absl::IsResourceExhausted(status))
            return finish(
                {grpc::StatusCode::RESOURCE_EXHAUSTED,
                 "this lossless stream was read too slowly and its queue is full; read faster, request "
                 "larger voxels, or use LATEST_ONLY"});
        const Clock::time_point now = Clock::now();
        const Clock::duration fair_period = slot_ ? slot_->period() : Clock::duration{0};
        if (status.ok() && now < next_) {
            // Limited by the fair share: the next message is due soon and newer; a timer per message would
            // cost as much as sending it.
            return wait_until(period_ >= fair_period ? next_ : next_ + 4 * fair_period);
        }
        auto taken = box_->take();
        if (!taken) {
            if (!status.ok()) finish(to_grpc(status));
            return;
        }
        // Late by less than a period: keep the schedule. Later, or the first message: restart it.
        const Clock::duration period = std::max(period_, fair_period);
        next_ = (next_ + period > now ? next_ : now) + period;
        try {
            message_ = translate_(*taken);
        } catch (const std::exception& error) {
            spdlog::error("a stream ends: {}", error.what());
            return finish({grpc::StatusCode::INTERNAL, error.what()});
        }
        writing_ = true;
        this->StartWrite(&message_);
    }

    void wait_until(Clock::time_point time) {
        if (std::exchange(timer_runs_, true)) return;
        timer_.expires_at(time);
        // Not bound to the strand: a bound handler counts as work of the encoders, and a timer that never
        // fires after the timers' io_context has stopped would block shutdown.
        timer_.async_wait([weak = this->weak_from_this()](const boost::system::error_code& error) {
            const auto self = weak.lock();
            if (!self || error) return;
            boost::asio::post(self->strand_, [self] {
                self->timer_runs_ = false;
                self->advance();
            });
        });
    }

    std::shared_ptr<StreamReactor> self_;  // until OnDone
    boost::asio::strand<boost::asio::any_io_executor> strand_;
    boost::asio::steady_timer timer_;
    Translate translate_;
    std::shared_ptr<Box> box_;
    std::shared_ptr<Guard::Stream> counted_;
    std::optional<FairShare::Slot> slot_;
    absl::Status ended_;  // by the guard
    Message message_;     // must live until OnWriteDone
    Clock::duration period_{0};
    Clock::time_point next_{};
    std::atomic<bool> woken_ = false;
    bool writing_ = false, cancelled_ = false, finished_ = false, timer_runs_ = false;
};

}  // namespace kinevox
