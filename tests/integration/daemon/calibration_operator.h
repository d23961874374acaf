// An operator who calibrates with a real daemon, and the images that its cameras see.
#pragma once

#include <fmt/format.h>
#include <gmock/gmock.h>

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <functional>
#include <memory>
#include <random>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "client/lib/client.h"
#include "common/files.h"
#include "common/proto_time.h"
#include "server/cameras/frame_source.h"
#include "tests/support/patience.h"

namespace kinevox::testing {

inline constexpr const char* kBoard = "charuco:6x5:160:120:DICT_4X4_100";
inline constexpr const char* kWand = "wand:200:600";

inline absl::Status status_of(const absl::Status& status) {
    return status;
}
template <typename T>
absl::Status status_of(const absl::StatusOr<T>& result) {
    return result.status();
}

#define EXPECT_REFUSED(call, status_code, words)                                  \
    do {                                                                          \
        const absl::Status refused = ::kinevox::testing::status_of(call);         \
        EXPECT_EQ(refused.code(), absl::StatusCode::status_code) << refused;      \
        EXPECT_THAT(std::string(refused.message()), ::testing::HasSubstr(words)); \
    } while (false)

inline void must(const absl::Status& status) {
    if (!status.ok()) throw std::runtime_error(std::string(status.message()));
}

// As PPM: compressing it would take longer than drawing it.
inline void write_image(const Image& bgr, const std::filesystem::path& file) {
    std::string bytes = fmt::format("P6\n{} {}\n255\n", bgr.width, bgr.height);
    const std::size_t begin = bytes.size(), count = static_cast<std::size_t>(3) * bgr.width * bgr.height;
    bytes.append(reinterpret_cast<const char*>(bgr.data.get()), count);
    for (std::size_t i = begin; i < bytes.size(); i += 3) std::swap(bytes[i], bytes[i + 2]);
    must(write_file_atomically(file, bytes));
}

// A grey wall with a little noise: the studio's room takes longer to draw than all the boards before it.
inline Image wall(const Camera& camera, std::uint32_t seed) {
    const std::size_t bytes = static_cast<std::size_t>(3) * camera.width * camera.height;
    const std::shared_ptr<std::uint8_t[]> data(new std::uint8_t[bytes]);
    std::mt19937 random(seed);
    for (std::size_t i = 0; i < bytes; ++i) data[i] = static_cast<std::uint8_t>(100 + random() % 4);
    return {camera.width, camera.height, 3, data};
}

// One operator at a daemon, who watches the procedure all the time.
class Operator {
  public:
    explicit Operator(const std::string& address)
        : client_({.server = address, .timeout = patient(std::chrono::milliseconds(5'000))}) {
        v1::AcquireControlRequest request;
        request.set_operator_name("coach");
        *request.mutable_timeout() = to_duration(patient(std::chrono::milliseconds(120'000)));
        const auto lease = client_.acquire_control(request);
        if (lease.ok()) lease_ = lease->lease_id();
    }

    client::Client& client() { return client_; }
    const std::string& lease() const { return lease_; }

    v1::StartProcedureRequest procedure(v1::ProcedureKind kind) const {
        v1::StartProcedureRequest request;
        request.set_lease_id(lease_);
        request.set_kind(kind);
        request.set_board(kBoard);
        request.set_wand(kWand);
        return request;
    }
    absl::Status start(v1::ProcedureKind kind) { return client_.start_procedure(procedure(kind)).status(); }
    absl::Status take(v1::LiveObservations::Step what) {
        v1::AddObservationsRequest request;
        request.set_lease_id(lease_);
        request.mutable_live()->set_step(what);
        return client_.add_observations(request).status();
    }
    // One a camera, in the folder of the camera's name.
    v1::AddObservationsRequest clips(const std::vector<Camera>& cameras,
                                     const std::filesystem::path& folder) const {
        v1::AddObservationsRequest request;
        request.set_lease_id(lease_);
        for (const Camera& camera : cameras) {
            v1::CameraClip& clip = *request.mutable_files()->add_clips();
            clip.set_camera(camera.name);
            clip.set_path((folder / camera.name).string());
        }
        return request;
    }
    absl::Status solve() {
        v1::SolveProcedureRequest request;
        request.set_lease_id(lease_);
        return client_.solve_procedure(request).status();
    }
    absl::Status cancel(bool keep = false) {
        v1::CancelProcedureRequest request;
        request.set_lease_id(lease_);
        request.set_keep_observations(keep);
        return client_.cancel_procedure(request).status();
    }
    absl::StatusOr<v1::ApplyCalibrationResponse> apply(const std::string& id, bool restart,
                                                       bool force = false) {
        v1::ApplyCalibrationRequest request;
        request.set_lease_id(lease_);
        request.set_calibration_id(id);
        request.set_restart_capture(restart);
        request.set_force(force);
        return client_.apply_calibration(request);
    }
    absl::StatusOr<v1::UndoCalibrationResponse> undo(bool restart) {
        v1::UndoCalibrationRequest request;
        request.set_lease_id(lease_);
        request.set_restart_capture(restart);
        return client_.undo_calibration(request);
    }
    absl::StatusOr<std::string> import(const std::string& text, v1::CalibrationFormat format) {
        v1::ImportCalibrationRequest request;
        request.set_lease_id(lease_);
        request.set_data(text);
        request.set_format(format);
        request.set_note("from a file");
        const auto response = client_.import_calibration(request);
        return response.ok() ? absl::StatusOr<std::string>(response->calibration_id()) : response.status();
    }
    absl::StatusOr<std::string> export_as(const std::string& id, v1::CalibrationFormat format) {
        v1::ExportCalibrationRequest request;
        request.set_calibration_id(id);
        request.set_format(format);
        const auto response = client_.export_calibration(request);
        return response.ok() ? absl::StatusOr<std::string>(response->data()) : response.status();
    }
    v1::ListCalibrationsResponse list() {
        return client_.list_calibrations({}).value_or(v1::ListCalibrationsResponse());
    }
    // The messages of a kind's events, past ones too, until there are `count`.
    std::vector<std::string> events(v1::EventKind kind, std::size_t count,
                                    std::chrono::seconds idle_timeout) {
        std::vector<std::string> messages;
        v1::WatchEventsRequest past;
        past.set_history_count(50);
        const absl::Status watched = client_.watch_events(past,
                                                          [&](const v1::WatchEventsResponse& message) {
                                                              const v1::Event& event = message.event();
                                                              if (event.kind() == kind)
                                                                  messages.push_back(event.message());
                                                              return messages.size() < count;
                                                          },
                                                          {.idle_timeout = idle_timeout});
        EXPECT_TRUE(watched.ok()) << watched;
        return messages;
    }

    // Watches until it is so; fifteen seconds of silence at most.
    v1::WatchProcedureResponse wait(const std::function<bool(const v1::WatchProcedureResponse&)>& so) {
        v1::WatchProcedureResponse last;
        client::StreamOptions options;
        options.idle_timeout = patient(std::chrono::seconds(15));
        const absl::Status status = client_.watch_procedure(
            [&](const v1::WatchProcedureResponse& progress) {
                last = progress;
                return !so(progress);
            },
            options);
        EXPECT_TRUE(status.ok()) << status << "\n" << last.DebugString();
        return last;
    }

  private:
    client::Client client_;
    std::string lease_;
};

inline bool over(const v1::WatchProcedureResponse& progress) {
    return progress.state() >= v1::PROCEDURE_STATE_SOLVED;
}
inline bool collecting(const v1::WatchProcedureResponse& progress) {
    return progress.state() == v1::PROCEDURE_STATE_COLLECTING;
}

inline void wait_until_running(client::Client& client) {
    const auto begun = std::chrono::steady_clock::now();
    while (std::chrono::steady_clock::now() - begun < std::chrono::seconds(20)) {
        const auto status = client.status();
        if (status.ok() && status->state() == v1::CAPTURE_STATE_RUNNING) return;
        std::this_thread::yield();
    }
    ADD_FAILURE() << "the capture did not start";
}

}  // namespace kinevox::testing
