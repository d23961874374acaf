// CaptureService and StreamService over an in-process channel, against a fake capture.
#include <grpcpp/generic/generic_stub.h>

#include <atomic>
#include <future>
#include <numbers>
#include <thread>

#include "kinevox/v1/capture_service.grpc.pb.h"
#include "kinevox/v1/stream_service.grpc.pb.h"
#include "server/api/request_arguments.h"
#include "tests/integration/api/api_fixture.h"
#include "tests/support/patience.h"

namespace kinevox {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

TEST_F(ApiTest, GetStatusReportsStateRatesAndSubjects) {
    auto status = client_.status();
    ASSERT_TRUE(status.ok()) << status.status();
    EXPECT_EQ(status->state(), v1::CAPTURE_STATE_STOPPED);
    EXPECT_EQ(status->source(), "fake");
    EXPECT_EQ(status->subjects_size(), 0);
    EXPECT_EQ(status->cameras(0).subjects_size(), 0);

    auto collected = collect({}, 1);
    start();
    source_.give(1);
    collected.get();
    status = client_.status();
    EXPECT_EQ(status->state(), v1::CAPTURE_STATE_RUNNING);
    EXPECT_EQ(status->result_count(), 1u);
    EXPECT_EQ(status->nominal_fps(), 100);
    EXPECT_EQ(status->latest_stage_times().hull_ms(), 2);
    ASSERT_EQ(status->subjects_size(), 1);
    const v1::SubjectStatus& subject = status->subjects(0);
    EXPECT_EQ(subject.volume().voxel_count(), voxel_count(*volume_));
    EXPECT_TRUE(subject.pose_found());
    EXPECT_EQ(subject.subject().subject_id(), 1u);
    EXPECT_THAT(subject.subject().used_cameras(), ElementsAre("left"));
    ASSERT_EQ(status->cameras(0).subjects_size(), 1);
    ASSERT_EQ(status->cameras(1).subjects_size(), 1);
    const v1::CameraSubjectStatus &left = status->cameras(0).subjects(0),
                                  &right = status->cameras(1).subjects(0);
    EXPECT_EQ(left.subject_id(), 1u);
    EXPECT_NEAR(right.silhouette_iou(), 0.8, 1e-6);
    EXPECT_TRUE(left.used());
    EXPECT_FALSE(right.used());
}

TEST_F(ApiTest, ListCamerasReturnsCompleteCalibration) {
    const auto cameras = client_.cameras();
    ASSERT_TRUE(cameras.ok());
    EXPECT_EQ(*cameras, testing::fake_cameras());
}

// Each page of ListCameras holds one camera.
TEST_F(ApiTest, ListCamerasReturnsPages) {
    const auto stub = v1::CaptureService::NewStub(server_->in_process_channel());
    v1::ListCamerasRequest request;
    request.set_page_size(1);
    std::vector<std::string> names;
    do {
        grpc::ClientContext context;
        v1::ListCamerasResponse response;
        ASSERT_TRUE(stub->ListCameras(&context, request, &response).ok());
        ASSERT_EQ(response.cameras_size(), 1);
        names.push_back(response.cameras(0).name());
        request.set_page_token(response.next_page_token());
    } while (!request.page_token().empty());
    EXPECT_THAT(names, ElementsAre("left", "right"));
    request.set_page_size(-1);
    grpc::ClientContext context;
    v1::ListCamerasResponse response;
    EXPECT_EQ(stub->ListCameras(&context, request, &response).error_code(),
              grpc::StatusCode::INVALID_ARGUMENT);
}

TEST_F(ApiTest, StartStopAndLearnRequireControl) {
    for (const std::string id : {"", "not a lease"}) {
        EXPECT_EQ(client_.start(client::Lease{id}).code(), absl::StatusCode::kFailedPrecondition);
        EXPECT_EQ(client_.stop(client::Lease{id}).code(), absl::StatusCode::kFailedPrecondition);
        EXPECT_EQ(client_.learn_background(client::Lease{id}, 0, std::chrono::seconds(5)).code(),
                  absl::StatusCode::kFailedPrecondition);
    }
    const std::string id = acquire("ann");
    const absl::Status other = client_.start("bob");
    EXPECT_EQ(other.code(), absl::StatusCode::kFailedPrecondition);
    EXPECT_THAT(std::string(other.message()), HasSubstr("held by 'ann' for another"));
    EXPECT_TRUE(client_.start(client::Lease{id}).ok());
    EXPECT_EQ(client_.start(client::Lease{id}).code(), absl::StatusCode::kFailedPrecondition) << "it runs";
    EXPECT_TRUE(client_.stop(client::Lease{id}).ok());
    EXPECT_TRUE(client_.learn_background(client::Lease{id}, 0, std::chrono::seconds(5)).ok());
    EXPECT_EQ(client_.learn_background(client::Lease{id}, -3, std::chrono::seconds(5)).code(),
              absl::StatusCode::kInvalidArgument);
    EXPECT_EQ(client_.status()->control_lease().operator_name(), "ann");
    EXPECT_TRUE(client_.renew_control(id).ok());
    EXPECT_TRUE(client_.release_control(id).ok());
    EXPECT_FALSE(client_.status()->has_control_lease());
    EXPECT_FALSE(client_.renew_control(id).ok());
}

TEST_F(ApiTest, LearnBackgroundReturnsWhenLearned) {
    auto seen = collect({}, 1);
    start();
    source_.give(1);
    seen.get();
    auto learned = std::async(std::launch::async, [&] {
        return client_.learn_background("tester", 3, std::chrono::seconds(10), /*force=*/true);
    });
    EXPECT_TRUE(testing::eventually(
        [&] { return client_.status()->state() == v1::CAPTURE_STATE_LEARNING_BACKGROUND; }));
    source_.give(3);
    EXPECT_TRUE(learned.get().ok());
}

TEST_F(ApiTest, LearnBackgroundIsRefusedWhileASubjectIsTracked) {
    auto seen = collect({}, 1);
    start();
    source_.give(1);
    seen.get();
    const absl::Status refused = client_.learn_background("tester", 3, std::chrono::seconds(10));
    EXPECT_EQ(refused.code(), absl::StatusCode::kFailedPrecondition);
    EXPECT_THAT(std::string(refused.message()), ::testing::HasSubstr("--force"));
    EXPECT_EQ(client_.status()->state(), v1::CAPTURE_STATE_RUNNING);
    EXPECT_EQ(client_.restore_background("tester").code(), absl::StatusCode::kFailedPrecondition)
        << "it runs";
}

TEST_F(ApiTest, WatchEventsReturnsHistoryInOrder) {
    start();
    ASSERT_TRUE(client_.stop("tester").ok());
    std::vector<v1::EventKind> kinds;
    v1::WatchEventsRequest request;
    request.set_history_count(7);
    const absl::Status status = client_.watch_events(request,
                                                     [&](const v1::WatchEventsResponse& message) {
                                                         return kinds.push_back(message.event().kind()),
                                                                kinds.size() < 7;
                                                     },
                                                     {});
    EXPECT_TRUE(status.ok());
    EXPECT_THAT(kinds, ElementsAre(v1::EVENT_KIND_CONTROL_ACQUIRED, v1::EVENT_KIND_BACKGROUND_LEARNED,
                                   v1::EVENT_KIND_CAPTURE_STARTED, v1::EVENT_KIND_CONTROL_RELEASED,
                                   v1::EVENT_KIND_CONTROL_ACQUIRED, v1::EVENT_KIND_CAPTURE_STOPPED,
                                   v1::EVENT_KIND_CONTROL_RELEASED));
    request.set_history_count(101);
    EXPECT_EQ(client_.watch_events(request, [](const auto&) { return true; }, {}).code(),
              absl::StatusCode::kInvalidArgument);
}

TEST_F(ApiTest, StreamVolumesDeliversEveryResultLosslessly) {
    v1::StreamVolumesRequest request;
    request.set_delivery(v1::DELIVERY_LOSSLESS);
    auto collected = collect(request, 50);
    start();
    source_.give(50);
    const Collected out = collected.get();
    ASSERT_TRUE(out.status.ok()) << out.status;
    for (std::size_t i = 0; i < out.frames.size(); ++i) {
        EXPECT_EQ(out.frames[i].header.sequence(), i);
        EXPECT_EQ(out.frames[i].header.missed_count(), 0u);
        ASSERT_EQ(out.frames[i].subjects.size(), 1u);
        EXPECT_EQ(out.frames[i].subjects[0].subject.subject_id(), 1u);
        EXPECT_EQ(out.frames[i].header.stage_times().total_ms(), 5);
    }
    EXPECT_EQ(out.frames[1].header.capture_time_ns() - out.frames[0].header.capture_time_ns(), 10'000'000);
    const client::SubjectVolume& first = out.frames[0].subjects[0];
    ASSERT_TRUE(first.volume);
    EXPECT_EQ(first.volume->bricks, volume_->bricks);
    EXPECT_EQ(first.volume->colours.size(), volume_->colours.size());
    EXPECT_NEAR(first.volume_litres, volume_litres(*volume_), 1e-9);
}

TEST_F(ApiTest, StreamVolumesSendsRequestedResolution) {
    v1::StreamVolumesRequest coarse, plain;
    coarse.set_max_voxel_m(0.09);  // 0.08 is the largest multiple of 0.02 by powers of 2
    plain.set_downsample_level(1);
    plain.set_omit_colours(true);
    auto first = collect(coarse, 1), second = collect(plain, 1);
    start();
    source_.give(1);
    EXPECT_NEAR(first.get().frames.at(0).subjects.at(0).volume->grid.voxel_m, 0.08, 1e-9);
    const Collected out = second.get();
    const client::SubjectVolume& subject = out.frames.at(0).subjects.at(0);
    EXPECT_NEAR(subject.volume->grid.voxel_m, 0.04, 1e-9);
    EXPECT_TRUE(subject.volume->colours.empty());
    EXPECT_NEAR(subject.volume_litres, volume_litres(*volume_), 1e-9) << "at the capture's own resolution";
}

TEST_F(ApiTest, StreamVolumesCountsMissedResults) {
    v1::StreamVolumesRequest request;
    request.set_max_rate_hz(50);
    auto collected = collect(request, 5);
    start();
    std::atomic<bool> done{false};
    std::thread giver([&] {  // as fast as possible, so that the rate limit drops some
        while (!done) source_.give(1), std::this_thread::yield();
    });
    const auto begin = std::chrono::steady_clock::now();
    const Collected out = collected.get();
    const std::chrono::duration<double> took = std::chrono::steady_clock::now() - begin;
    done = true;
    giver.join();
    ASSERT_TRUE(out.status.ok());
    EXPECT_GE(took.count(), 4 / 50.0 * 0.99) << "five messages at 50 Hz take at least four periods";
    for (std::size_t i = 1; i < out.frames.size(); ++i)
        EXPECT_EQ(out.frames[i].header.sequence(),
                  out.frames[i - 1].header.sequence() + 1 + out.frames[i].header.missed_count());
}

TEST_F(ApiTest, LatestOnlySubscribersShareTheMessageRate) {
    constexpr std::size_t kWatchers = 4;
    api_.streams.fair_share = &share_.emplace(40);  // 10 Hz each
    constexpr std::uint64_t kLast = 199;
    std::vector<std::future<std::vector<std::uint64_t>>> watchers;
    for (std::size_t i = 0; i < kWatchers; ++i)
        watchers.push_back(std::async(std::launch::async, [&] {
            std::vector<std::uint64_t> sequences;
            std::uint64_t accounted = 0;
            const absl::Status status =
                client_.stream_poses({},
                                     [&](const v1::StreamPosesResponse& message) {
                                         accounted += 1 + message.header().missed_count();
                                         sequences.push_back(message.header().sequence());
                                         return sequences.back() < kLast;
                                     },
                                     {});
            EXPECT_TRUE(status.ok()) << status;
            EXPECT_EQ(accounted, kLast + 1);
            return sequences;
        }));
    EXPECT_TRUE(testing::eventually([&] { return hub_.subscribers().poses >= static_cast<int>(kWatchers); }));
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
    EXPECT_TRUE(testing::eventually([&] { return hub_.subscribers().poses != static_cast<int>(kWatchers); }));
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
    EXPECT_EQ(all.get(), static_cast<int>(kLast) + 1) << "lossless subscribers are not limited";
}

TEST_F(ApiTest, OverflowingLosslessStreamEndsWithResourceExhausted) {
    // Reads nothing until the queue is full. Uses the stub, because the client library reads on its own.
    api_.streams.lossless_max_messages = 8;
    const auto stub = v1::StreamService::NewStub(server_->in_process_channel());
    grpc::ClientContext context;
    v1::StreamVolumesRequest request;
    request.set_delivery(v1::DELIVERY_LOSSLESS);
    const auto reader = stub->StreamVolumes(&context, request);
    reader->WaitForInitialMetadata();
    start();
    source_.give(2000);  // far more than the transport buffers
    EXPECT_TRUE(testing::eventually([&] { return runner_.snapshot().result_count >= 2000; }));
    v1::StreamVolumesResponse message;
    std::uint64_t messages = 0;
    while (reader->Read(&message)) {
        EXPECT_EQ(message.header().sequence(), messages) << "no message is missed before the end";
        ++messages;
    }
    const grpc::Status status = reader->Finish();
    EXPECT_EQ(status.error_code(), grpc::StatusCode::RESOURCE_EXHAUSTED) << status.error_message();
    EXPECT_THAT(status.error_message(), HasSubstr("read too slowly"));
    EXPECT_LT(messages, 2000u);
}

TEST_F(ApiTest, StreamVolumesRejectsInvalidRequests) {
    const auto status_of = [&](auto set) {
        v1::StreamVolumesRequest request;
        set(request);
        return client_.stream_volumes(request, [](const auto&) { return true; }, {}).code();
    };
    constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;
    EXPECT_EQ(status_of([](auto& r) { r.set_max_voxel_m(0); }), kInvalid);
    EXPECT_EQ(status_of([](auto& r) { r.set_max_voxel_m(std::nan("")); }), kInvalid);
    EXPECT_EQ(status_of([](auto& r) { r.set_downsample_level(6); }), kInvalid);
    EXPECT_EQ(status_of([](auto& r) { r.set_downsample_level(-1); }), kInvalid);
    EXPECT_EQ(status_of([](auto& r) { r.set_max_rate_hz(-1); }), kInvalid);
    EXPECT_EQ(status_of([](auto& r) { r.set_max_rate_hz(1e-12); }), kInvalid);
    EXPECT_EQ(status_of([](auto& r) { r.set_delivery(static_cast<v1::Delivery>(9)); }), kInvalid);
    EXPECT_EQ(status_of([](auto& r) { r.set_delivery(v1::DELIVERY_LOSSLESS), r.set_max_rate_hz(5); }),
              kInvalid);
}

TEST_F(ApiTest, StreamPosesCarriesValuesAndWithheldReasons) {
    v1::StreamPosesRequest request;
    request.set_delivery(v1::DELIVERY_LOSSLESS);
    std::vector<v1::StreamPosesResponse> messages;
    auto streamed = std::async(std::launch::async, [&] {
        return client_.stream_poses(
            request, [&](const auto& m) { return messages.push_back(m), messages.size() < 20; }, {});
    });
    EXPECT_TRUE(testing::eventually([&] { return hub_.subscribers().poses != 0; }));
    EXPECT_EQ(client_.status()->pose_subscriber_count(), 1);
    start();
    source_.give(20);
    ASSERT_TRUE(streamed.get().ok());
    for (std::size_t i = 0; i < messages.size(); ++i) {
        EXPECT_EQ(messages[i].header().sequence(), i);
        EXPECT_EQ(messages[i].header().missed_count(), 0u);
        ASSERT_EQ(messages[i].subjects_size(), 1);
        EXPECT_EQ(messages[i].subjects(0).subject_id(), 1u);
    }
    const v1::Pose& pose = messages[0].subjects(0).pose();
    ASSERT_EQ(pose.joints_size(), static_cast<int>(kJointNames.size()));
    ASSERT_EQ(pose.angles_size(), static_cast<int>(kJointAngleNames.size()));
    EXPECT_EQ(pose.joints(1).name(), "sacroiliac");
    EXPECT_NEAR(pose.joints(1).position_in_world().x(), 0.1, 1e-12);
    const v1::JointEstimate& hidden = pose.joints(pose.joints_size() - 1);
    EXPECT_FALSE(hidden.has_position_in_world());
    EXPECT_EQ(hidden.withheld_reason(), "outside every image");
    EXPECT_FALSE(pose.angles(0).has_value_deg());
    EXPECT_NEAR(pose.angles(1).value_deg(), 0.5 * 180 / std::numbers::pi, 1e-9);
    EXPECT_FALSE(pose.angles(1).has_velocity_deg_per_s());
    EXPECT_NEAR(pose.angles(2).velocity_deg_per_s(), 180 / std::numbers::pi, 1e-9);
    EXPECT_EQ(pose.segment_orientations(0).name(), "pelvis");
    EXPECT_TRUE(pose.ratios().has_knee_hip_flexion_ratio_l());
    EXPECT_FALSE(pose.ratios().has_knee_hip_flexion_ratio_r());
}

TEST_F(ApiTest, StreamPosesCarriesModelCoordinates) {
    v1::StreamPosesRequest request;
    request.set_delivery(v1::DELIVERY_LOSSLESS);
    v1::StreamPosesResponse message;
    auto streamed = std::async(std::launch::async, [&] {
        return client_.stream_poses(request, [&](const auto& m) { return message = m, false; }, {});
    });
    EXPECT_TRUE(testing::eventually([&] { return hub_.subscribers().poses != 0; }));
    start();
    source_.give(1);
    ASSERT_TRUE(streamed.get().ok());
    ASSERT_EQ(message.subjects_size(), 1);
    const v1::Pose& pose = message.subjects(0).pose();
    ASSERT_EQ(pose.coordinates_size(), 29);
    ASSERT_EQ(pose.translations_size(), 3);
    for (int k = 0; k < 3; ++k) EXPECT_EQ(pose.translations(k).name(), kBodyDofs[k].name);
    for (int k = 0; k < 29; ++k) EXPECT_EQ(pose.coordinates(k).name(), kBodyDofs[k + 3].name);
    for (const v1::CoordinateEstimate& coordinate : pose.coordinates())
        EXPECT_EQ(coordinate.has_value_deg(), coordinate.withheld_reason().empty()) << coordinate.name();
    // The fake's toe_r is withheld, and the ankle's coordinates with it.
    const auto find = [&](const std::string& name) {
        return *std::ranges::find_if(pose.coordinates(), [&](const auto& c) { return c.name() == name; });
    };
    EXPECT_TRUE(find("knee_angle_l").has_value_deg());
    EXPECT_FALSE(find("ankle_angle_r").has_value_deg());
}

TEST_F(ApiTest, StreamPosesRejectsInvalidRequests) {
    v1::StreamPosesRequest request;
    request.set_max_rate_hz(-1);
    const auto status_of = [&] {
        return client_.stream_poses(request, [](const auto&) { return true; }, {}).code();
    };
    EXPECT_EQ(status_of(), absl::StatusCode::kInvalidArgument);
    request.set_max_rate_hz(5);
    request.set_delivery(v1::DELIVERY_LOSSLESS);
    EXPECT_EQ(status_of(), absl::StatusCode::kInvalidArgument);
}

TEST_F(ApiTest, StreamPreviewsSendsImageAndSilhouette) {
    const auto preview = [&](auto set) {
        v1::StreamPreviewsRequest request;
        request.set_camera("left");
        set(request);
        client::PreviewFrame out;
        auto got = std::async(std::launch::async, [&] {
            return client_.stream_previews(request,
                                           [&](const client::PreviewFrame& f) { return out = f, false; }, {});
        });
        EXPECT_TRUE(testing::eventually([&] { return hub_.subscribers().images != 0; }));
        source_.give(1);
        EXPECT_TRUE(got.get().ok());
        EXPECT_TRUE(testing::eventually([&] { return hub_.subscribers().images == 0; }));
        return out;
    };
    start();
    const auto frame = preview([](auto&) {});
    EXPECT_EQ(frame.camera, "left");
    EXPECT_EQ(frame.image.width, 64);
    EXPECT_EQ(frame.image.channels, 3);
    EXPECT_NEAR(frame.image.data[0], 100, 4) << "grey value of the fake's first image";
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
    EXPECT_NEAR(at(11, 12), 128, 25);  // loose only
    EXPECT_LT(at(2, 2), 15);
}

TEST_F(ApiTest, StreamPreviewsRejectsInvalidRequests) {
    const auto status_of = [&](auto set) {
        v1::StreamPreviewsRequest request;
        request.set_camera("left");
        set(request);
        return client_.stream_previews(request, [](const auto&) { return true; }, {});
    };
    const absl::Status unknown = status_of([](auto& r) { r.set_camera("middle"); });
    EXPECT_EQ(unknown.code(), absl::StatusCode::kNotFound);
    EXPECT_THAT(std::string(unknown.message()), HasSubstr("left, right"));
    constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;
    EXPECT_EQ(status_of([](auto& r) { r.set_max_width_px(3); }).code(), kInvalid);
    EXPECT_EQ(status_of([](auto& r) { r.set_max_height_px(100'000); }).code(), kInvalid);
    EXPECT_EQ(status_of([](auto& r) { r.set_jpeg_quality(101); }).code(), kInvalid);
    EXPECT_EQ(status_of([](auto& r) { r.set_max_rate_hz(1e9); }).code(), kInvalid);
}

TEST_F(ApiTest, RejectedStreamCanBeCancelledAtOnce) {
    const auto stub = v1::StreamService::NewStub(server_->in_process_channel());
    v1::StreamPosesRequest request;
    request.set_max_rate_hz(-1);
    for (int i = 0; i < 500; ++i) {  // in some iterations the cancellation arrives before the status is sent
        grpc::ClientContext context;
        const auto reader = stub->StreamPoses(&context, request);
        context.TryCancel();
        EXPECT_FALSE(reader->Finish().ok());
    }
    EXPECT_TRUE(client_.status().ok());
}

TEST_F(ApiTest, StreamsEndWithUnavailableAtShutdown) {
    auto collected = collect({}, 1000);
    runner_.abort();
    hub_.close(absl::UnavailableError("the daemon is stopping; connect again later"));
    const absl::Status status = collected.get().status;
    EXPECT_EQ(status.code(), absl::StatusCode::kUnavailable);
    EXPECT_THAT(std::string(status.message()), HasSubstr("the daemon is stopping"));
}

TEST_F(ApiTest, CancelledSubscriberIsRemoved) {
    std::stop_source stop;
    client::StreamOptions options;
    options.stop = stop.get_token();
    auto ended = std::async(std::launch::async, [&] {
        return client_.stream_volumes(
            {}, [](const auto&) { return true; }, options);
    });
    EXPECT_TRUE(testing::eventually([&] { return hub_.subscribers().volumes != 0; }));
    stop.request_stop();
    EXPECT_EQ(ended.get().code(), absl::StatusCode::kCancelled);
    EXPECT_TRUE(testing::eventually([&] { return hub_.subscribers().volumes == 0; }));
}

// A unary call of a method whose messages this build has only as bytes.
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

TEST(LevelFor, KeepsEdgeWithinRequestedMaximum) {
    EXPECT_EQ(level_for(0.01, 0.01), 0);
    EXPECT_EQ(level_for(0.01, 0.019), 0);
    EXPECT_EQ(level_for(0.01, 0.02), 1);
    EXPECT_EQ(level_for(0.01, 0.005), 0) << "finer than available";
    EXPECT_EQ(level_for(0.01, 1e9), 5);
}

}  // namespace
}  // namespace kinevox
