#include "server/metrics/capture_metrics.h"

#include <array>
#include <chrono>
#include <cmath>
#include <cstdint>

#include "server/api/api_context.h"
#include "server/api/version.h"
#include "server/metrics/capture_figures.h"
#include "server/metrics/process_figures.h"
#include "server/pipeline/gpu.h"
#include "server/recording/recorder.h"

namespace kinevox::metrics {
namespace {

constexpr std::array<std::pair<RunState, const char*>, 6> kStates{{{RunState::kStopped, "stopped"},
                                                                   {RunState::kStarting, "starting"},
                                                                   {RunState::kRunning, "running"},
                                                                   {RunState::kLearning, "learning"},
                                                                   {RunState::kEnded, "ended"},
                                                                   {RunState::kFailed, "failed"}}};

void write_capture(const ApiContext& api, MetricsText& text) {
    const RunState state = api.runner.state().state;
    text.gauge("kinevox_state", "What the capture does: 1 for the state it is in.");
    for (const auto& [each, name] : kStates) text.sample(each == state ? 1 : 0, {{"state", name}});
    const RunFigures figures = api.runner.figures();
    text.one_gauge("kinevox_source_frame_sets_per_second", "The source's nominal rate.",
                   api.runner.source_fps());
    text.one_gauge("kinevox_results_per_second", "Results a second over the last two seconds.",
                   state == RunState::kRunning ? figures.results_per_second : 0);
    text.one_counter("kinevox_results", "Results since the capture's last start.",
                     static_cast<double>(figures.results));
    text.one_counter("kinevox_lost_frame_sets",
                     "Frame sets lost before the pipeline since the capture's last start.",
                     static_cast<double>(figures.lost));
    const auto newest = api.hub.newest();
    const FrameResult* const result = newest ? newest->result.get() : nullptr;
    text.one_gauge("kinevox_subject_tracked", "1 while somebody is tracked.",
                   result && result->subject ? 1 : 0);
    text.one_gauge("kinevox_pose_found", "1 while the newest result has a pose.",
                   result && result->pose ? 1 : 0);
    text.one_gauge("kinevox_subject_volume_litres", "Of the newest result.",
                   result && result->volume ? volume_litres(*result->volume) : 0);
}

void write_stages(const CaptureFigures& figures, MetricsText& text) {
    text.histogram("kinevox_stage_seconds",
                   "What a frame set spends in each stage of the pipeline; total: in all of it.");
    const std::pair<const char*, const RunningHistogram*> stages[] = {
        {"segmentation", &figures.segmentation}, {"tracking", &figures.tracking}, {"hull", &figures.hull},
        {"colouring", &figures.colouring},       {"pose", &figures.pose},         {"total", &figures.total}};
    for (const auto& [name, histogram] : stages) text.sample(histogram->read(), {{"stage", name}});
}

void write_streams(const ApiContext& api, const CaptureFigures& figures, MetricsText& text) {
    const StreamHub::Subscribers subscribers = api.hub.subscribers();
    text.gauge("kinevox_subscribers", "Who is subscribed at the moment.");
    text.sample(subscribers.volumes, {{"stream", "volumes"}});
    text.sample(subscribers.poses, {{"stream", "poses"}});
    text.sample(subscribers.pictures, {{"stream", "previews"}});
    text.sample(subscribers.events, {{"stream", "events"}});
    const std::pair<const char*, const StreamFigures*> streams[] = {
        {"volumes", &figures.volumes}, {"poses", &figures.poses}, {"previews", &figures.pictures}};
    text.histogram("kinevox_stream_lag_seconds",
                   "Age of a message when it is handed to a subscriber's connection.");
    for (const auto& [name, stream] : streams) text.sample(stream->age.read(), {{"stream", name}});
    text.counter("kinevox_stream_messages", "Messages sent to subscribers.");
    for (const auto& [name, stream] : streams)
        text.sample(static_cast<double>(stream->sent), {{"stream", name}});
    text.counter("kinevox_stream_missed",
                 "Messages that subscribers missed since they read too slowly or asked for fewer.");
    for (const auto& [name, stream] : streams)
        text.sample(static_cast<double>(stream->missed), {{"stream", name}});
}

// Of live cameras; other sources have no links.
void write_links(const std::vector<Camera>& cameras, const std::vector<CameraLink>& links,
                 MetricsText& text) {
    if (links.empty()) return;
    const auto each = [&](const auto& value) {
        for (std::size_t i = 0; i < std::min(cameras.size(), links.size()); ++i)
            text.sample(value(links[i]), {{"camera", cameras[i].name}});
    };
    const auto count = [&](const char* name, const char* help, std::uint64_t CameraLink::*field) {
        text.counter(name, help);
        each([&](const CameraLink& link) { return static_cast<double>(link.*field); });
    };
    text.gauge("kinevox_camera_connected", "1 while the camera delivers pictures.");
    each([](const CameraLink& link) { return link.connected ? 1.0 : 0.0; });
    count("kinevox_camera_pictures", "Complete pictures that got into a frame set.", &CameraLink::pictures);
    count("kinevox_camera_pictures_lost",
          "Pictures of which nothing arrived, or for which no buffer was free.", &CameraLink::lost);
    count("kinevox_camera_pictures_incomplete", "Pictures whose packets were missing.",
          &CameraLink::incomplete);
    count("kinevox_camera_pictures_late", "Pictures that came when their frame set was gone.",
          &CameraLink::late);
    count("kinevox_camera_pictures_unmatched", "Pictures that too few others had the time of.",
          &CameraLink::unmatched);
    count("kinevox_camera_disconnects", "Times that the camera went away.", &CameraLink::disconnects);
    count("kinevox_camera_packets_missing", "Packets that never came.", &CameraLink::packets_missing);
    count("kinevox_camera_packets_resent", "Packets that came on request.", &CameraLink::packets_resent);
    text.gauge("kinevox_camera_skew_seconds",
               "Its time against the middle of its frame sets, mean of the newest 128.");
    each([](const CameraLink& link) { return link.skew_ms / 1e3; });
    text.gauge("kinevox_camera_lateness_seconds",
               "Its pictures' arrival behind the first of their set, mean of the newest 128.");
    each([](const CameraLink& link) { return link.lateness_ms / 1e3; });
}

void write_cameras(const ApiContext& api, MetricsText& text) {
    const std::vector<Camera> cameras = api.runner.cameras();
    write_links(cameras, api.runner.camera_links(), text);
    const auto newest = api.hub.newest();
    text.gauge("kinevox_camera_silhouette_agreement",
               "Volume's projection against the silhouette, 0 to 1; absent while nobody is tracked.");
    if (newest)
        for (std::size_t i = 0; i < std::min(cameras.size(), newest->result->silhouette_iou.size()); ++i)
            if (const float iou = newest->result->silhouette_iou[i]; !std::isnan(iou))
                text.sample(static_cast<double>(iou), {{"camera", cameras[i].name}});
    if (!api.camera_watch || (api.replay && api.replay->status().open)) return;
    const std::vector<WatchedCamera> watched = api.camera_watch->cameras();
    text.gauge("kinevox_camera_calibration_disagreement_pixels",
               "How far what stands still in its pictures has moved since the capture began; absent where it "
               "is not known.");
    for (std::size_t i = 0; i < std::min(cameras.size(), watched.size()); ++i)
        if (watched[i].shift_px) text.sample(*watched[i].shift_px, {{"camera", cameras[i].name}});
    text.gauge("kinevox_camera_calibration_suspect", "1 where the camera seems to have moved.");
    for (std::size_t i = 0; i < std::min(cameras.size(), watched.size()); ++i)
        text.sample(watched[i].suspect ? 1 : 0, {{"camera", cameras[i].name}});
}

void write_recorder(const ApiContext& api, MetricsText& text) {
    if (!api.recorder || api.recorder->options().folder.empty()) return;
    const RecorderStatus status = api.recorder->status();
    text.one_gauge("kinevox_recording", "1 while a recording is being made.",
                   status.state == RecorderState::kIdle ? 0 : 1);
    text.one_gauge("kinevox_recording_free_bytes", "Free on the recordings' disk.",
                   static_cast<double>(status.free_bytes));
    text.one_gauge("kinevox_recording_queued_bytes", "Taken and not yet written.",
                   static_cast<double>(status.queued_bytes));
    text.one_gauge("kinevox_recording_held_seconds", "Kept in memory for `record keep`.",
                   status.held_seconds);
}

void write_gpu(const ApiContext& api, MetricsText& text) {
    const Gpu::State gpu = api.gpu ? api.gpu->state() : Gpu::State{.usable = false};
    text.gauge("kinevox_compute_device", "1 for the device that computes.");
    text.sample(gpu.usable ? 0 : 1, {{"device", "cpu"}});
    text.sample(gpu.usable ? 1 : 0, {{"device", "cuda"}});
    text.one_gauge("kinevox_gpu_configured", "1 where the configuration asks for a GPU.", api.gpu ? 1 : 0);
    text.one_counter("kinevox_gpu_failures",
                     "Times that the GPU could not be used or failed, so that the CPU computes.",
                     static_cast<double>(gpu.failures));
    text.one_gauge("kinevox_gpu_memory_used_bytes",
                   "Of the GPU that computes, by all programs; 0 where none does.",
                   static_cast<double>(gpu.memory.used_bytes));
    text.one_gauge("kinevox_gpu_memory_total_bytes", "Of the GPU that computes; 0 where none does.",
                   static_cast<double>(gpu.memory.total_bytes));
}

void write_process(MetricsText& text) {
    const ProcessFigures figures = process_figures();
    text.one_gauge("kinevox_resident_memory_bytes", "Of the daemon.",
                   static_cast<double>(figures.resident_bytes));
    text.one_counter("kinevox_processor_seconds", "Of all its threads since its start.", figures.processor_s);
    text.one_gauge("kinevox_open_files", "Files and connections that it has open.", figures.open_files);
    text.one_gauge("kinevox_open_files_limit", "How many it may have.",
                   static_cast<double>(figures.open_files_limit));
}

}  // namespace

std::string capture_metrics(const ApiContext& api, Format format) {
    MetricsText text(format);
    text.gauge("kinevox_build_info", "1; the labels say what runs here.");
    text.sample(1, {{"version", kVersion}, {"source", api.source_description}});
    text.one_gauge("kinevox_uptime_seconds", "Since the daemon's start.",
                   std::chrono::duration<double>(std::chrono::steady_clock::now() - api.started_at).count());
    write_capture(api, text);
    if (api.figures) {
        write_stages(*api.figures, text);
        write_streams(api, *api.figures, text);
    }
    write_cameras(api, text);
    write_recorder(api, text);
    write_gpu(api, text);
    write_process(text);
    return text.take();
}

}  // namespace kinevox::metrics
