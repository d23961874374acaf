// PoseService.FitBody and WatchBody over an in-process channel, with silhouettes rendered from a body model.
#include "common/proto_time.h"
#include "kinevox/v1/pose_service.grpc.pb.h"
#include "tests/integration/api/api_fixture.h"
#include "tests/support/seen_body.h"

namespace kinevox {
namespace {

using ::testing::HasSubstr;

class BodyFitApiTest : public ApiTest {
  protected:
    BodyFitApiTest() {
        LiveBodyFitOptions options;
        options.automatic = false;
        options.fit.max_frames = 6;
        fit_ = std::make_unique<LiveBodyFit>(
            scene_.cameras, 10, PoseStageOptions(), options,
            LiveBodyFit::Observers{[this](const std::vector<BodyFitProgress>& all) { watch_.publish(all); },
                                   {}});
        watch_.publish(fit_->progress());
        api_.poses.body_fit = fit_.get();
        api_.poses.body_watch = &watch_;
    }
    ~BodyFitApiTest() override {  // in the order of the daemon
        fit_->close();
        watch_.close(absl::UnavailableError("the daemon is stopping; connect again later"));
        server_->shutdown(std::chrono::milliseconds(500));
    }
    void show(int frames) {
        for (int n = 0; n < frames; ++n, time_ns_ += 100'000'000) {
            const PoseObservation seen{time_ns_, {0, 0, 0.95}, scene_.see(scene_.t_pose())};
            const LiveBodyFit::Seen subject{1, &seen};
            fit_->observe(time_ns_, {&subject, 1});
        }
    }

    testing::SeenBody scene_{.model = std::make_shared<BodyModel>(default_body_shape(1.85))};
    BodyWatch watch_;
    std::unique_ptr<LiveBodyFit> fit_;
    std::int64_t time_ns_ = 0;
};

v1::FitBodyRequest for_seconds(double seconds) {
    v1::FitBodyRequest request;
    *request.mutable_duration() = duration_from_s(seconds);
    return request;
}

TEST_F(ApiTest, FitBodyFailsWithoutPoses) {
    EXPECT_EQ(client_.fit_body("ann", {}).code(), absl::StatusCode::kFailedPrecondition);
    const absl::Status watched = client_.watch_body([](const auto&) { return true; }, {});
    EXPECT_EQ(watched.code(), absl::StatusCode::kFailedPrecondition);
    EXPECT_THAT(std::string(watched.message()), HasSubstr("[pose]"));
}

TEST_F(BodyFitApiTest, WatchBodyReportsFitToTheEnd) {
    const absl::Status stopped = client_.fit_body("ann", for_seconds(1));
    EXPECT_EQ(stopped.code(), absl::StatusCode::kFailedPrecondition) << "the capture does not run";
    start();
    std::vector<v1::SubjectBody> reported;
    const absl::Status status = client_.watch_body(
        [&](const v1::WatchBodyResponse& message) {
            EXPECT_EQ(message.subjects_size(), 1);
            const v1::SubjectBody& progress = message.subjects(0);
            if (reported.empty()) {
                const absl::Status begun = client_.fit_body("ann", for_seconds(1));
                EXPECT_TRUE(begun.ok()) << begun;
                show(12);
            }
            reported.push_back(progress);
            return progress.state() != v1::BODY_FIT_STATE_READY &&
                   progress.state() != v1::BODY_FIT_STATE_FAILED;
        },
        {});
    ASSERT_TRUE(status.ok()) << status;
    EXPECT_EQ(reported.front().state(), v1::BODY_FIT_STATE_NOT_STARTED);
    EXPECT_FALSE(reported.front().body().stature().has_std_m()) << "the default body";
    EXPECT_EQ(reported.front().body().frame_set_count(), 0);
    const v1::SubjectBody& last = reported.back();
    ASSERT_EQ(last.state(), v1::BODY_FIT_STATE_READY) << last.message();
    EXPECT_TRUE(last.requested());
    EXPECT_GT(last.body().frame_set_count(), 3);
    EXPECT_NEAR(last.body().stature().value_m(), 1.85, 0.04);
    EXPECT_GT(last.body().stature().std_m(), 0);
    EXPECT_EQ(last.body().lengths_size(), kBodyLengthCount);
    for (const v1::BodyMeasurement& girth : last.body().girths()) {
        EXPECT_GT(girth.value_m(), 0.1) << girth.name();
        EXPECT_LT(girth.value_m(), 1.3) << girth.name();
        EXPECT_GT(girth.std_m(), 0) << girth.name();
    }
    EXPECT_NEAR(fit_->body_in_use(1).shape.stature_m, 1.85, 0.04);
}

TEST_F(BodyFitApiTest, FitBodyRejectsInvalidRequests) {
    start();
    EXPECT_EQ(client_.fit_body("ann", for_seconds(0.2)).code(), absl::StatusCode::kInvalidArgument);
    EXPECT_EQ(client_.fit_body("ann", for_seconds(-1)).code(), absl::StatusCode::kInvalidArgument);
    const auto stub = v1::PoseService::NewStub(server_->in_process_channel());
    grpc::ClientContext context;
    v1::FitBodyResponse response;
    EXPECT_EQ(stub->FitBody(&context, for_seconds(1), &response).error_code(),
              grpc::StatusCode::FAILED_PRECONDITION);
    v1::FitBodyRequest stranger = for_seconds(1);
    stranger.set_subject_id(7);
    EXPECT_EQ(client_.fit_body("ann", stranger).code(), absl::StatusCode::kNotFound);
    acquire("bob");
    const absl::Status refused = client_.fit_body("ann", for_seconds(1));
    EXPECT_EQ(refused.code(), absl::StatusCode::kFailedPrecondition);
    EXPECT_THAT(std::string(refused.message()), HasSubstr("bob"));
    EXPECT_EQ(fit_->progress().front().state, BodyFitState::kNotStarted);
}

}  // namespace
}  // namespace kinevox
