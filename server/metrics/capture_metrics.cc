#include "server/metrics/capture_metrics.h"

#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <filesystem>
#include <fstream>

namespace kinevox::metrics {
namespace {

constexpr std::array<std::pair<RunState, const char*>, 6> kStates{
    {{RunState::kStopped, "stopped"},
     {RunState::kStarting, "starting"},
     {RunState::kRunning, "running"},
     {RunState::kLearning, "learning_background"},
     {RunState::kEnded, "source_ended"},
     {RunState::kFailed, "failed"}}};

void write_capture(const MetricsSnapshot& snapshot, MetricsText& text) {
    text.gauge("kinevox_capture_state", "State of the capture: 1 for the current one.");
    for (const auto& [each, name] : kStates) text.sample(each == snapshot.state ? 1 : 0, {{"state", name}});
    text.one_gauge("kinevox_source_nominal_fps", "Nominal frame sets per second of the source.",
                   snapshot.nominal_fps);
    text.one_counter("kinevox_frame_sets_processed", "Results since the last start of the capture.",
                     static_cast<double>(snapshot.run.result_count));
    text.one_counter("kinevox_frame_sets_lost",
                     "Frame sets lost before the pipeline since the last start of the capture.",
                     static_cast<double>(snapshot.run.lost_count));
    text.one_gauge("kinevox_subjects_tracked", "Tracked subjects in the latest result.",
                   snapshot.subjects_tracked);
    text.one_gauge("kinevox_subjects_with_pose", "Subjects with a pose in the latest result.",
                   snapshot.subjects_with_pose);
    text.gauge("kinevox_subject_volume_litres", "Volume of each tracked subject in the latest result.");
    for (const auto& [subject_id, litres] : snapshot.subject_volumes_litres)
        text.sample(litres, {{"subject", std::to_string(subject_id)}});
}

void write_stages(const MetricsSnapshot& snapshot, MetricsText& text) {
    text.histogram("kinevox_stage_duration_seconds",
                   "Duration of each pipeline stage per frame set; total: from arrival to result.");
    for (const auto& [name, histogram] : snapshot.stages_s) text.sample(histogram, {{"stage", name}});
}

void write_streams(const MetricsSnapshot& snapshot, MetricsText& text) {
    text.gauge("kinevox_subscribers", "Current subscribers.");
    for (const StreamMetrics& stream : snapshot.streams)
        text.sample(stream.subscribers, {{"stream", stream.name}});
    const auto each = [&](const auto& write) {
        for (const StreamMetrics& stream : snapshot.streams)
            if (stream.latency_s) write(stream);
    };
    text.histogram("kinevox_stream_latency_seconds",
                   "Latency from the publication of a message to its hand-over to the connection.");
    each([&](const StreamMetrics& stream) { text.sample(*stream.latency_s, {{"stream", stream.name}}); });
    text.counter("kinevox_stream_messages_sent", "Messages sent to subscribers.");
    each([&](const StreamMetrics& stream) {
        text.sample(static_cast<double>(stream.sent), {{"stream", stream.name}});
    });
    text.counter("kinevox_stream_messages_missed",
                 "Messages missed by subscribers that read too slowly or requested a lower rate.");
    each([&](const StreamMetrics& stream) {
        text.sample(static_cast<double>(stream.missed), {{"stream", stream.name}});
    });
}

void write_connections(const std::vector<CameraMetrics>& cameras, MetricsText& text) {
    if (std::ranges::none_of(cameras, [](const CameraMetrics& each) { return each.connection.has_value(); }))
        return;
    const auto each = [&](const auto& value) {
        for (const CameraMetrics& camera : cameras)
            if (camera.connection) text.sample(value(*camera.connection), {{"camera", camera.name}});
    };
    const auto count = [&](const char* name, const char* help, std::uint64_t CameraConnection::*field) {
        text.counter(name, help);
        each([&](const CameraConnection& camera) { return static_cast<double>(camera.*field); });
    };
    text.gauge("kinevox_camera_connected", "1 while the camera delivers images.");
    each([](const CameraConnection& camera) { return camera.connected ? 1.0 : 0.0; });
    count("kinevox_camera_images", "Complete images that entered a frame set.",
          &CameraConnection::image_count);
    count("kinevox_camera_images_lost", "Images of which nothing arrived or for which no buffer was free.",
          &CameraConnection::lost_image_count);
    count("kinevox_camera_images_incomplete", "Images with missing packets.",
          &CameraConnection::incomplete_image_count);
    count("kinevox_camera_images_late", "Images that arrived after their frame set was completed.",
          &CameraConnection::late_image_count);
    count("kinevox_camera_images_unmatched", "Images without enough others of the same time.",
          &CameraConnection::unmatched_image_count);
    count("kinevox_camera_disconnects", "Disconnections of the camera.", &CameraConnection::disconnect_count);
    count("kinevox_camera_packets_missing", "Packets that never arrived.",
          &CameraConnection::missing_packet_count);
    count("kinevox_camera_packets_resent", "Packets that arrived on request.",
          &CameraConnection::resent_packet_count);
    text.gauge("kinevox_camera_skew_seconds",
               "Mean difference from the centre time of its latest 128 frame sets.");
    each([](const CameraConnection& camera) { return camera.mean_skew_ms / 1e3; });
    text.gauge("kinevox_camera_arrival_delay_seconds",
               "Mean arrival delay after the first image of its latest 128 frame sets.");
    each([](const CameraConnection& camera) { return camera.mean_arrival_delay_ms / 1e3; });
}

void write_cameras(const std::vector<CameraMetrics>& cameras, MetricsText& text) {
    write_connections(cameras, text);
    text.gauge(
        "kinevox_camera_silhouette_iou",
        "IoU of the volume's projection and the silhouette, 0 to 1, of several subjects the lowest; absent "
        "while no subject is tracked.");
    for (const CameraMetrics& camera : cameras)
        if (camera.silhouette_iou) text.sample(*camera.silhouette_iou, {{"camera", camera.name}});
    text.gauge("kinevox_camera_scene_shift_pixels",
               "Shift of the static scene since the capture started; absent while unknown.");
    for (const CameraMetrics& camera : cameras)
        if (camera.scene_shift_px) text.sample(*camera.scene_shift_px, {{"camera", camera.name}});
    text.gauge("kinevox_camera_calibration_suspect", "1 if the camera seems to have moved.");
    for (const CameraMetrics& camera : cameras)
        if (camera.calibration_suspect)
            text.sample(*camera.calibration_suspect ? 1 : 0, {{"camera", camera.name}});
}

void write_recorder(const std::optional<RecorderMetrics>& recorder, MetricsText& text) {
    if (!recorder) return;
    text.one_gauge("kinevox_recording_active", "1 while a recording is running.", recorder->active ? 1 : 0);
    text.one_gauge("kinevox_recording_free_bytes", "Free space on the disk of the recordings.",
                   static_cast<double>(recorder->free_bytes));
    text.one_gauge("kinevox_recording_queued_bytes", "Data that is not written yet.",
                   static_cast<double>(recorder->queued_bytes));
    text.one_gauge("kinevox_recording_buffered_seconds", "Length of the rolling buffer's content.",
                   recorder->buffered_s);
}

void write_gpu(const MetricsSnapshot& snapshot, MetricsText& text) {
    const Gpu::State& gpu = snapshot.gpu;
    text.gauge("kinevox_compute_device", "1 for the device that computes.");
    text.sample(gpu.usable ? 0 : 1, {{"device", "cpu"}});
    if (snapshot.gpu_configured) text.sample(gpu.usable ? 1 : 0, {{"device", gpu.device}, {"gpu", gpu.name}});
    text.one_gauge("kinevox_gpu_configured", "1 if the configuration requests a GPU.",
                   snapshot.gpu_configured ? 1 : 0);
    text.one_counter("kinevox_gpu_failures", "Failures of the GPU, after which the CPU computes.",
                     static_cast<double>(gpu.failures));
    text.one_gauge("kinevox_gpu_memory_used_bytes",
                   "Memory of the GPU in use by all programs; 0 while the CPU computes.",
                   static_cast<double>(gpu.memory.used_bytes));
    text.one_gauge("kinevox_gpu_memory_total_bytes", "Memory of the GPU; 0 while the CPU computes.",
                   static_cast<double>(gpu.memory.total_bytes));
}

// What the kernel reports about this process; a value that cannot be read is 0.
struct ProcessStatistics {
    std::uint64_t resident_bytes = 0;
    double cpu_s = 0;  // of all threads
    int open_files = 0;
    std::uint64_t max_open_files = 0;
};

ProcessStatistics process_statistics() {
    ProcessStatistics out;
    std::uint64_t pages = 0, resident = 0;
    if (std::ifstream("/proc/self/statm") >> pages >> resident)
        out.resident_bytes = resident * static_cast<std::uint64_t>(sysconf(_SC_PAGESIZE));
    rusage usage{};
    if (getrusage(RUSAGE_SELF, &usage) == 0)
        out.cpu_s = static_cast<double>(usage.ru_utime.tv_sec + usage.ru_stime.tv_sec) +
                    1e-6 * static_cast<double>(usage.ru_utime.tv_usec + usage.ru_stime.tv_usec);
    std::error_code error;
    for (auto it = std::filesystem::directory_iterator("/proc/self/fd", error);
         !error && it != std::filesystem::directory_iterator(); it.increment(error))
        ++out.open_files;
    rlimit files{};
    if (getrlimit(RLIMIT_NOFILE, &files) == 0) out.max_open_files = files.rlim_cur;
    return out;
}

// By the names that Prometheus client libraries use.
void write_process(double start_time_s, MetricsText& text) {
    const ProcessStatistics process = process_statistics();
    text.one_gauge("process_start_time_seconds", "Start time of the process since the Unix epoch in seconds.",
                   start_time_s);
    text.one_gauge("process_resident_memory_bytes", "Resident memory size in bytes.",
                   static_cast<double>(process.resident_bytes));
    text.one_counter("process_cpu_seconds", "Total user and system CPU time spent in seconds.",
                     process.cpu_s);
    text.one_gauge("process_open_fds", "Number of open file descriptors.", process.open_files);
    text.one_gauge("process_max_fds", "Maximum number of open file descriptors.",
                   static_cast<double>(process.max_open_files));
}

}  // namespace

std::string capture_metrics(const MetricsSnapshot& snapshot, Format format) {
    MetricsText text(format);
    text.gauge("kinevox_build_info", "1; the label has the version.");
    text.sample(1, {{"version", snapshot.version}});
    text.gauge("kinevox_source_info", "1; the label describes the source.");
    text.sample(1, {{"source", snapshot.source}});
    write_capture(snapshot, text);
    write_stages(snapshot, text);
    write_streams(snapshot, text);
    write_cameras(snapshot.cameras, text);
    write_recorder(snapshot.recorder, text);
    write_gpu(snapshot, text);
    write_process(snapshot.start_time_s, text);
    return text.take();
}

}  // namespace kinevox::metrics
