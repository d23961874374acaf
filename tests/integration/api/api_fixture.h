// The API over an in-process channel, against a fake capture.
#pragma once

#include <gmock/gmock.h>
#include <grpcpp/grpcpp.h>
#include <gtest/gtest.h>

#include <boost/asio/executor_work_guard.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/thread_pool.hpp>
#include <future>
#include <thread>

#include "client/lib/client.h"
#include "server/api/api_server.h"
#include "server/api/subscribers.h"
#include "tests/support/fake_capture.h"
#include "tests/support/person_volume.h"

namespace kinevox {

namespace asio = boost::asio;

class ApiTest : public ::testing::Test {
  protected:
    ApiTest() : client_(server_->in_process_channel()) {}
    ~ApiTest() override {
        runner_.abort();
        hub_.close(absl::UnavailableError("the daemon is stopping; connect again later"));
        server_->shutdown(std::chrono::milliseconds(500));
        control_.join();
        runner_.stop().IgnoreError();
        encoders_.join();
        io_.stop();
        io_thread_.join();
    }

    std::string acquire(const std::string& operator_name = "tester") {
        v1::AcquireControlRequest request;
        request.set_operator_name(operator_name);
        const auto lease = client_.acquire_control(request);
        EXPECT_TRUE(lease.ok()) << lease.status();
        return lease.ok() ? lease->lease_id() : "";
    }

    void start() { ASSERT_TRUE(client_.start("tester").ok()); }

    // The first `count` messages of a stream, collected on another thread.
    struct Collected {
        std::vector<client::VolumeFrame> frames;
        absl::Status status;
    };
    std::future<Collected> collect(const v1::StreamVolumesRequest& request, std::size_t count) {
        const int before = hub_.subscribers().volumes;
        auto collected = std::async(std::launch::async, [this, request, count] {
            Collected out;
            out.status = client_.stream_volumes(request,
                                                [&](const client::VolumeFrame& frame) {
                                                    out.frames.push_back(frame);
                                                    return out.frames.size() < count;
                                                },
                                                {});
            return out;
        });
        while (hub_.subscribers().volumes == before &&
               collected.wait_for(std::chrono::milliseconds(1)) != std::future_status::ready) {
        }
        return collected;
    }

    const std::shared_ptr<const Volume> volume_ =
        std::make_shared<const Volume>(testing::person_volume(0.02));
    testing::FakeSourceControl source_;
    StreamHub hub_;
    ControlLease lease_;
    std::unique_ptr<testing::FakePipeline> made_ = std::make_unique<testing::FakePipeline>(volume_);
    testing::FakePipeline& pipeline_ = *made_;  // the runner's
    Runner runner_{source_.open(), [this] { return source_.open(); }, std::move(made_), hub_};
    asio::io_context io_;
    asio::executor_work_guard<asio::io_context::executor_type> work_{io_.get_executor()};
    std::thread io_thread_{[this] { io_.run(); }};
    asio::thread_pool control_{1}, encoders_{2};
    std::optional<FairShare> share_;
    ApiContext api_{.runner = runner_,
                    .hub = hub_,
                    .lease = lease_,
                    .threads = {.control = control_.get_executor(),
                                .encoders = encoders_.get_executor(),
                                .timers = io_.get_executor()},
                    .source_description = "fake"};
    std::unique_ptr<ApiServer> server_ = ApiServer::in_process(api_);
    client::Client client_;
};

}  // namespace kinevox
