// Each call of capture and stream service over an in-process channel, against a fake capture.
#include <grpcpp/generic/generic_stub.h>

#include <atomic>
#include <future>
#include <numbers>
#include <thread>

#include "kinevox/v1/stream_service.grpc.pb.h"
#include "server/api/stream_service.h"
#include "tests/integration/api/api_fixture.h"

namespace kinevox {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

TEST_F(ApiTest, GetStatusTellsStateRatesAndSubject) {
    auto status = client_.status();
    ASSERT_TRUE(status.ok()) << status.status();
    EXPECT_EQ(status->state(), v1::CAPTURE_STATE_STOPPED);
    EXPECT_EQ(status->source(), "fake");
    EXPECT_FALSE(status->has_volume());
    EXPECT_TRUE(std::isnan(status->cameras(0).silhouette_iou()));

    auto collected = collect({}, 1);
    start();
    source_.give(1);
    collected.get();
    status = client_.status();
    EXPECT_EQ(status->state(), v1::CAPTURE_STATE_RUNNING);
    EXPECT_EQ(status->results(), 1u);
    EXPECT_EQ(status->source_fps(), 100);
    EXPECT_EQ(status->newest_times().hull_ms(), 2);
    EXPECT_EQ(status->volume().voxels(), voxel_count(*volume_));
    EXPECT_EQ(status->subject().subject_id(), 1u);
    EXPECT_THAT(status->subject().cameras_used(), ElementsAre("left"));
    EXPECT_NEAR(status->cameras(1).silhouette_iou(), 0.8, 1e-6);
    EXPECT_TRUE(status->cameras(0).used());
    EXPECT_FALSE(status->cameras(1).used());
}

TEST_F(ApiTest, ListCamerasCarriesTheWholeCalibration) {
    const auto cameras = client_.cameras();
    ASSERT_TRUE(cameras.ok());
    EXPECT_EQ(*cameras, testing::fake_cameras());
}

TEST_F(ApiTest, StartStopAndLearnNeedControl) {
    for (const std::string id : {"", "not a lease"}) {
        EXPECT_EQ(client_.start_with(id).code(), absl::StatusCode::kFailedPrecondition);
        EXPECT_EQ(client_.stop_with(id).code(), absl::StatusCode::kFailedPrecondition);
        EXPECT_EQ(client_.learn_background_with(id, 0, std::chrono::seconds(5)).code(),
                  absl::StatusCode::kFailedPrecondition);
    }
    const std::string id = acquire("ann");
    const absl::Status other = client_.start("bob");
    EXPECT_EQ(other.code(), absl::StatusCode::kFailedPrecondition);
    EXPECT_THAT(std::string(other.message()), HasSubstr("held by 'ann' for another"));
    EXPECT_TRUE(client_.start_with(id).ok());
    EXPECT_EQ(client_.start_with(id).code(), absl::StatusCode::kFailedPrecondition) << "it runs";
    EXPECT_TRUE(client_.stop_with(id).ok());
    EXPECT_TRUE(client_.learn_background_with(id, 0, std::chrono::seconds(5)).ok());
    EXPECT_EQ(client_.learn_background_with(id, -3, std::chrono::seconds(5)).code(),
              absl::StatusCode::kInvalidArgument);
    EXPECT_EQ(client_.status()->control().holder(), "ann");
    EXPECT_TRUE(client_.renew_control(id).ok());
    EXPECT_TRUE(client_.release_control(id).ok());
    EXPECT_FALSE(client_.status()->has_control());
    EXPECT_FALSE(client_.renew_control(id).ok());
}

TEST_F(ApiTest, LearnBackgroundAnswersWhenItIsLearned) {
    auto seen = collect({}, 1);
    start();
    source_.give(1);
    seen.get();
    auto learned = std::async(
        std::launch::async, [&] { return client_.learn_background("tester", 3, std::chrono::seconds(10)); });
    while (client_.status()->state() != v1::CAPTURE_STATE_LEARNING) {
    }
    source_.give(3);
    EXPECT_TRUE(learned.get().ok());
}

TEST_F(ApiTest, WatchEventsTellsWhatHappensInOrder) {
    start();
    ASSERT_TRUE(client_.stop("tester").ok());
    std::vector<v1::EventKind> kinds;
    v1::WatchEventsRequest request;
    request.set_past(7);
    const absl::Status status = client_.watch_events(
        request,
        [&](const v1::WatchEventsResponse& event) { return kinds.push_back(event.kind()), kinds.size() < 7; },
        {});
    EXPECT_TRUE(status.ok());
    EXPECT_THAT(kinds, ElementsAre(v1::EVENT_KIND_CONTROL_TAKEN, v1::EVENT_KIND_BACKGROUND_LEARNED,
                                   v1::EVENT_KIND_STARTED, v1::EVENT_KIND_CONTROL_RELEASED,
                                   v1::EVENT_KIND_CONTROL_TAKEN, v1::EVENT_KIND_STOPPED,
                                   v1::EVENT_KIND_CONTROL_RELEASED));
    request.set_past(101);
    EXPECT_EQ(client_.watch_events(request, [](const auto&) { return true; }, {}).code(),
              absl::StatusCode::kInvalidArgument);
}

TEST_F(ApiTest, StreamVolumesLosslessDeliversEveryResultDecodable) {
    v1::StreamVolumesRequest request;
    request.set_delivery(v1::DELIVERY_LOSSLESS);
    auto collected = collect(request, 50);
    start();
    source_.give(50);
    const Collected out = collected.get();
    ASSERT_TRUE(out.status.ok()) << out.status;
    for (std::size_t i = 0; i < out.frames.size(); ++i) {
        EXPECT_EQ(out.frames[i].header.sequence(), i);
        EXPECT_EQ(out.frames[i].header.missed(), 0u);
        EXPECT_EQ(out.frames[i].header.subject_id(), 1u);
        EXPECT_EQ(out.frames[i].header.times().total_ms(), 5);
    }
    EXPECT_EQ(out.frames[1].header.capture_time_ns() - out.frames[0].header.capture_time_ns(), 10'000'000);
    ASSERT_TRUE(out.frames[0].volume);
    EXPECT_EQ(out.frames[0].volume->bricks, volume_->bricks);
    EXPECT_EQ(out.frames[0].volume->colours.size(), volume_->colours.size());
    EXPECT_NEAR(out.frames[0].litres, volume_litres(*volume_), 1e-9);
}

TEST_F(ApiTest, StreamVolumesSendsTheFormThatWasAskedFor) {
    v1::StreamVolumesRequest coarse, plain;
    coarse.set_max_voxel_m(0.09);  // 0.02, 0.04, 0.08 fit
    plain.set_level(1);
    plain.set_without_colours(true);
    auto first = collect(coarse, 1), second = collect(plain, 1);
    start();
    source_.give(1);
    EXPECT_NEAR(first.get().frames.at(0).volume->grid.voxel_m, 0.08, 1e-9);
    const Collected out = second.get();
    EXPECT_NEAR(out.frames.at(0).volume->grid.voxel_m, 0.04, 1e-9);
    EXPECT_TRUE(out.frames.at(0).volume->colours.empty());
    EXPECT_NEAR(out.frames.at(0).litres, volume_litres(*volume_), 1e-9) << "at the capture's own resolution";
}

TEST_F(ApiTest, StreamVolumesAccountsForEveryResultWhateverItMisses) {
    v1::StreamVolumesRequest request;
    request.set_max_rate_hz(50);
    auto collected = collect(request, 5);
    start();
    std::atomic<bool> done{false};
    std::thread giver([&] {  // as fast as they are taken, so that the rate's limit has something to drop
        while (!done) source_.give(1), std::this_thread::yield();
    });
    const auto begin = std::chrono::steady_clock::now();
    const Collected out = collected.get();
    const std::chrono::duration<double> took = std::chrono::steady_clock::now() - begin;
    done = true;
    giver.join();
    ASSERT_TRUE(out.status.ok());
    EXPECT_GE(took.count(), 4 / 50.0 * 0.99) << "five messages at 50 a second take at least four periods";
    for (std::size_t i = 1; i < out.frames.size(); ++i)
        EXPECT_EQ(out.frames[i].header.sequence(),
                  out.frames[i - 1].header.sequence() + 1 + out.frames[i].header.missed());
}

TEST_F(ApiTest, ManyWhoWantTheNewestShareWhatMayBeSentAndAllGetTheLast) {
    constexpr std::size_t kWatchers = 4;
    api_.share = &share_.emplace(40);  // ten a second each
    constexpr std::uint64_t kLast = 199;
    std::vector<std::future<std::vector<std::uint64_t>>> watchers;
    for (std::size_t i = 0; i < kWatchers; ++i)
        watchers.push_back(std::async(std::launch::async, [&] {
            std::vector<std::uint64_t> sequences;
            std::uint64_t accounted = 0;
            const absl::Status status =
                client_.stream_poses({},
                                     [&](const v1::StreamPosesResponse& message) {
                                         accounted += 1 + message.header().missed();
                                         sequences.push_back(message.header().sequence());
                                         return sequences.back() < kLast;
                                     },
                                     {});
            EXPECT_TRUE(status.ok()) << status;
            EXPECT_EQ(accounted, kLast + 1);
            return sequences;
        }));
    while (hub_.subscribers().poses < static_cast<int>(kWatchers)) std::this_thread::yield();
    v1::StreamPosesRequest lossless;
    lossless.set_delivery(v1::DELIVERY_LOSSLESS);
    auto all = std::async(std::launch::async, [&] {
        int messages = 0;
        EXPECT_TRUE(client_
                        .stream_poses(lossless,
                                      [&](const auto&) { return ++messages <= static_cast<int>(kLast); }, {})
                        .ok());
        return messages;
    });
    while (hub_.subscribers().poses == static_cast<int>(kWatchers)) std::this_thread::yield();
    start();
    const auto begin = std::chrono::steady_clock::now();
    for (std::uint64_t i = 0; i <= kLast; ++i) {
        source_.give(1);
        std::this_thread::sleep_for(std::chrono::milliseconds(5));
    }
    for (auto& watcher : watchers) {
        const std::size_t messages = watcher.get().size();
        const std::chrono::duration<double> took = std::chrono::steady_clock::now() - begin;
        EXPECT_GE(messages, 3u);
        EXPECT_LE(static_cast<double>(messages), took.count() * 10 + 2);
    }
    EXPECT_EQ(all.get(), static_cast<int>(kLast) + 1) << "who wants every message gets it";
}

TEST_F(ApiTest, AnOverflowingLosslessStreamEndsWithResourceExhausted) {
    // Reads nothing until the queue must be full: the raw stub, since the client library reads by itself.
    api_.lossless_max_messages = 8;
    const auto stub = v1::StreamService::NewStub(server_->in_process_channel());
    grpc::ClientContext context;
    v1::StreamVolumesRequest request;
    request.set_delivery(v1::DELIVERY_LOSSLESS);
    const auto reader = stub->StreamVolumes(&context, request);
    reader->WaitForInitialMetadata();
    start();
    source_.give(2000);  // far more than the transport can hold of them
    while (runner_.figures().results < 2000) std::this_thread::yield();
    v1::StreamVolumesResponse message;
    std::uint64_t messages = 0;
    while (reader->Read(&message)) {
        EXPECT_EQ(message.header().sequence(), messages) << "none is missed before the end";
        ++messages;
    }
    const grpc::Status status = reader->Finish();
    EXPECT_EQ(status.error_code(), grpc::StatusCode::RESOURCE_EXHAUSTED) << status.error_message();
    EXPECT_THAT(status.error_message(), HasSubstr("read too slowly"));
    EXPECT_LT(messages, 2000u);
}

TEST_F(ApiTest, StreamVolumesRefusesWhatMakesNoSense) {
    const auto told = [&](auto set) {
        v1::StreamVolumesRequest request;
        set(request);
        return client_.stream_volumes(request, [](const auto&) { return true; }, {}).code();
    };
    constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;
    EXPECT_EQ(told([](auto& r) { r.set_max_voxel_m(0); }), kInvalid);
    EXPECT_EQ(told([](auto& r) { r.set_max_voxel_m(std::nan("")); }), kInvalid);
    EXPECT_EQ(told([](auto& r) { r.set_level(6); }), kInvalid);
    EXPECT_EQ(told([](auto& r) { r.set_level(-1); }), kInvalid);
    EXPECT_EQ(told([](auto& r) { r.set_max_rate_hz(-1); }), kInvalid);
    EXPECT_EQ(told([](auto& r) { r.set_max_rate_hz(1e-12); }), kInvalid);
    EXPECT_EQ(told([](auto& r) { r.set_delivery(static_cast<v1::Delivery>(9)); }), kInvalid);
    EXPECT_EQ(told([](auto& r) { r.set_delivery(v1::DELIVERY_LOSSLESS), r.set_max_rate_hz(5); }), kInvalid);
}

TEST_F(ApiTest, StreamPosesLosslessCarriesValuesAndWhatIsWithheld) {
    v1::StreamPosesRequest request;
    request.set_delivery(v1::DELIVERY_LOSSLESS);
    std::vector<v1::StreamPosesResponse> messages;
    auto streamed = std::async(std::launch::async, [&] {
        return client_.stream_poses(
            request, [&](const auto& m) { return messages.push_back(m), messages.size() < 20; }, {});
    });
    while (hub_.subscribers().poses == 0) std::this_thread::yield();
    EXPECT_EQ(client_.status()->pose_subscribers(), 1);
    start();
    source_.give(20);
    ASSERT_TRUE(streamed.get().ok());
    for (std::size_t i = 0; i < messages.size(); ++i) {
        EXPECT_EQ(messages[i].header().sequence(), i);
        EXPECT_EQ(messages[i].header().missed(), 0u);
        EXPECT_EQ(messages[i].pose().subject_id(), 1u);
    }
    const v1::Pose& pose = messages[0].pose();
    ASSERT_EQ(pose.joints_size(), static_cast<int>(kJointNames.size()));
    ASSERT_EQ(pose.angles_size(), static_cast<int>(kJointAngleNames.size()));
    EXPECT_EQ(pose.joints(1).name(), "sacroiliac");
    EXPECT_NEAR(pose.joints(1).position_in_world().x(), 0.1, 1e-12);
    const v1::JointEstimate& hidden = pose.joints(pose.joints_size() - 1);
    EXPECT_FALSE(hidden.has_position_in_world());
    EXPECT_EQ(hidden.withheld(), "outside every picture");
    EXPECT_FALSE(pose.angles(0).has_value_deg());
    EXPECT_NEAR(pose.angles(1).value_deg(), 0.5 * 180 / std::numbers::pi, 1e-9);
    EXPECT_FALSE(pose.angles(1).has_velocity_deg_s());
    EXPECT_NEAR(pose.angles(2).velocity_deg_s(), 180 / std::numbers::pi, 1e-9);
    EXPECT_EQ(pose.segments(0).name(), "pelvis");
    EXPECT_TRUE(pose.ratios().has_knee_hip_l());
    EXPECT_FALSE(pose.ratios().has_knee_hip_r());
}

TEST_F(ApiTest, StreamPosesRefusesWhatMakesNoSense) {
    v1::StreamPosesRequest request;
    request.set_max_rate_hz(-1);
    const auto told = [&] {
        return client_.stream_poses(request, [](const auto&) { return true; }, {}).code();
    };
    EXPECT_EQ(told(), absl::StatusCode::kInvalidArgument);
    request.set_max_rate_hz(5);
    request.set_delivery(v1::DELIVERY_LOSSLESS);
    EXPECT_EQ(told(), absl::StatusCode::kInvalidArgument);
}

TEST_F(ApiTest, StreamPreviewsSendsPictureAndSilhouette) {
    const auto preview = [&](auto set) {
        v1::StreamPreviewsRequest request;
        request.set_camera("left");
        set(request);
        client::PreviewFrame out;
        auto got = std::async(std::launch::async, [&] {
            return client_.stream_previews(request,
                                           [&](const client::PreviewFrame& f) { return out = f, false; }, {});
        });
        while (hub_.subscribers().pictures == 0) std::this_thread::yield();
        source_.give(1);
        EXPECT_TRUE(got.get().ok());
        while (hub_.subscribers().pictures != 0) std::this_thread::yield();
        return out;
    };
    start();
    const auto picture = preview([](auto&) {});
    EXPECT_EQ(picture.camera, "left");
    EXPECT_EQ(picture.image.width, 64);
    EXPECT_EQ(picture.image.channels, 3);
    EXPECT_NEAR(picture.image.data[0], 100, 4) << "the fake's first grey";
    const auto silhouette = preview([](auto& r) {
        r.set_kind(v1::StreamPreviewsRequest::KIND_SILHOUETTE);
        r.set_max_width_px(32);
        r.set_jpeg_quality(95);
    });
    ASSERT_EQ(silhouette.image.width, 32);
    ASSERT_EQ(silhouette.image.height, 24);
    EXPECT_EQ(silhouette.image.channels, 1);
    const auto at = [&](int x, int y) { return silhouette.image.data[static_cast<std::size_t>(y * 32 + x)]; };
    EXPECT_GT(at(16, 12), 240);        // sharp
    EXPECT_NEAR(at(11, 12), 128, 25);  // loose alone
    EXPECT_LT(at(2, 2), 15);
}

TEST_F(ApiTest, StreamPreviewsRefusesWhatMakesNoSense) {
    const auto told = [&](auto set) {
        v1::StreamPreviewsRequest request;
        request.set_camera("left");
        set(request);
        return client_.stream_previews(request, [](const auto&) { return true; }, {});
    };
    const absl::Status unknown = told([](auto& r) { r.set_camera("middle"); });
    EXPECT_EQ(unknown.code(), absl::StatusCode::kNotFound);
    EXPECT_THAT(std::string(unknown.message()), HasSubstr("left, right"));
    constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;
    EXPECT_EQ(told([](auto& r) { r.set_max_width_px(3); }).code(), kInvalid);
    EXPECT_EQ(told([](auto& r) { r.set_max_height_px(100'000); }).code(), kInvalid);
    EXPECT_EQ(told([](auto& r) { r.set_jpeg_quality(101); }).code(), kInvalid);
    EXPECT_EQ(told([](auto& r) { r.set_max_rate_hz(1e9); }).code(), kInvalid);
}

TEST_F(ApiTest, ARefusedStreamMayBeCancelledAtOnce) {
    const auto stub = v1::StreamService::NewStub(server_->in_process_channel());
    v1::StreamPosesRequest request;
    request.set_max_rate_hz(-1);
    for (int i = 0; i < 500;
         ++i) {  // in some of them the word that the client left comes before the call is over
        grpc::ClientContext context;
        const auto reader = stub->StreamPoses(&context, request);
        context.TryCancel();
        EXPECT_FALSE(reader->Finish().ok());
    }
    EXPECT_TRUE(client_.status().ok());
}

TEST_F(ApiTest, WhenTheDaemonStopsStreamsEndSayingSo) {
    auto collected = collect({}, 1000);
    runner_.abort();
    hub_.close(absl::UnavailableError("the daemon is stopping; connect again later"));
    const absl::Status status = collected.get().status;
    EXPECT_EQ(status.code(), absl::StatusCode::kUnavailable);
    EXPECT_THAT(std::string(status.message()), HasSubstr("the daemon is stopping"));
}

TEST_F(ApiTest, AClientThatLeavesIsForgotten) {
    std::stop_source stop;
    client::StreamOptions options;
    options.stop = stop.get_token();
    auto ended = std::async(std::launch::async, [&] {
        return client_.stream_volumes(
            {}, [](const auto&) { return true; }, options);
    });
    while (hub_.subscribers().volumes == 0) std::this_thread::yield();
    stop.request_stop();
    EXPECT_EQ(ended.get().code(), absl::StatusCode::kCancelled);
    while (hub_.subscribers().volumes != 0) std::this_thread::yield();
}

// One request, one response of a method whose messages this build knows only as bytes.
std::string raw_call(const std::shared_ptr<grpc::Channel>& channel, const std::string& method,
                     const std::string& request) {
    grpc::GenericStub stub(channel);
    grpc::ClientContext context;
    context.set_deadline(std::chrono::system_clock::now() + std::chrono::seconds(10));
    grpc::CompletionQueue queue;
    const auto wait = [&] {
        void* tag = nullptr;
        bool ok = false;
        return queue.Next(&tag, &ok) && ok;
    };
    const auto call = stub.PrepareCall(&context, method, &queue);
    call->StartCall(nullptr);
    EXPECT_TRUE(wait());
    const grpc::Slice slice(request);
    call->WriteLast(grpc::ByteBuffer(&slice, 1), {}, nullptr);
    EXPECT_TRUE(wait());
    grpc::ByteBuffer response;
    call->Read(&response, nullptr);
    EXPECT_TRUE(wait());
    grpc::Slice whole;
    EXPECT_TRUE(response.DumpToSingleSlice(&whole).ok());
    grpc::Status status;
    call->Finish(&status, nullptr);
    wait();
    return {whole.begin(), whole.end()};
}

TEST_F(ApiTest, HealthAndReflectionAnswer) {
    const auto channel = server_->in_process_channel();
    server_->set_serving(false);
    EXPECT_EQ(raw_call(channel, "/grpc.health.v1.Health/Check", ""), "\x08\x02") << "NOT_SERVING";
    server_->set_serving(true);
    EXPECT_EQ(raw_call(channel, "/grpc.health.v1.Health/Check", ""), "\x08\x01") << "SERVING";
    const std::string listed =
        raw_call(channel, "/grpc.reflection.v1alpha.ServerReflection/ServerReflectionInfo",
                 std::string("\x3a\x00", 2));
    EXPECT_THAT(listed, HasSubstr("kinevox.v1.CaptureService"));
    EXPECT_THAT(listed, HasSubstr("kinevox.v1.StreamService"));
}

TEST(LevelFor, KeepsTheEdgeWithinWhatWasAskedFor) {
    EXPECT_EQ(level_for(0.01, 0.01), 0);
    EXPECT_EQ(level_for(0.01, 0.019), 0);
    EXPECT_EQ(level_for(0.01, 0.02), 1);
    EXPECT_EQ(level_for(0.01, 0.005), 0) << "finer than there is: what there is";
    EXPECT_EQ(level_for(0.01, 1e9), 5);
}

}  // namespace
}  // namespace kinevox
