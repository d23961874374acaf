// usage: make_api_seeds FOLDER
// Writes start scripts for api_fuzzer: two per method with random, reproducible fields, and typical call
// sequences.
#include <cstdio>
#include <random>
#include <string>
#include <vector>

#include "common/files.h"
#include "kinevox/v1/recording_service.pb.h"
#include "kinevox/v1/replay_service.pb.h"
#include "tests/fuzz/api_script.h"

namespace {

using namespace kinevox;
using namespace kinevox::fuzz;

std::size_t number_of(const std::string& name) {
    for (std::size_t m = 0; m < methods().size(); ++m)
        if (methods()[m].path.ends_with("/" + name)) return m;
    std::abort();
}

// The sequence of methods, with random requests and the fuzzer's lease.
std::vector<Step> sequence(const std::vector<std::string>& names, std::mt19937& random) {
    std::vector<Step> steps;
    for (const std::string& name : names) {
        Step step = random_step(number_of(name), random);
        step.who = Who::kAdmin;
        step.frame_sets = 3;
        if (!step.called().streams) step.ending = Ending::kRead;
        if (name == "StartCapture" || name == "StopCapture" || name == "StartRecording" ||
            name == "StopRecording") {
            v1::StopRecordingRequest lease;  // the lease is field 1 of all of these
            lease.set_lease_id(kLeasePlaceholder);
            step.request = lease.SerializeAsString();
        }
        if (name == "OpenReplay") {
            v1::OpenReplayRequest request;
            request.set_lease_id(kLeasePlaceholder);
            request.set_recording_name("seed");
            step.request = request.SerializeAsString();
        }
        steps.push_back(std::move(step));
    }
    return steps;
}

}  // namespace

int main(int argc, char** argv) {
    if (argc != 2) return std::fprintf(stderr, "usage: make_api_seeds FOLDER\n"), 1;
    std::mt19937 random(1);
    std::vector<std::vector<Step>> seeds;
    for (std::size_t m = 0; m < methods().size(); ++m)
        for (int i = 0; i < 2; ++i) seeds.push_back({random_step(m, random)});
    const std::vector<std::string> sequences[] = {
        {"StartCapture", "StreamVolumes", "StreamPoses", "StreamPreviews", "WatchEvents", "LearnBackground",
         "StopCapture"},
        {"StartCapture", "StartRecording", "GetRecorderStatus", "StopRecording", "ListRecordings",
         "ExportRecording", "DeleteRecording"},
        {"OpenReplay", "StartCapture", "UpdateReplay", "StreamPoses", "GetReplay", "UpdateReplay",
         "CloseReplay"},
        {"ImportCalibration", "ListCalibrations", "ApplyCalibration", "ExportCalibration", "UndoCalibration",
         "DeleteCalibration"},
        {"StartProcedure", "AddObservations", "WatchProcedure", "SolveProcedure", "CancelProcedure"},
        {"StartCapture", "StartProcedure", "AddObservations", "AddObservations", "SolveProcedure",
         "StopCapture"},
        {"AddLibraryPose", "ImportLibraryPoses", "ListLibraryPoses", "DeleteLibraryPose", "FitBody",
         "WatchBody"},
        {"AcquireControl", "RenewControl", "SaveBuffer", "ReleaseControl", "GetStatus"}};
    for (const auto& names : sequences)
        for (int i = 0; i < 3; ++i) seeds.push_back(sequence(names, random));
    for (std::size_t s = 0; s < seeds.size(); ++s) {
        const auto file = std::filesystem::path(argv[1]) / ("seed" + std::to_string(s));
        if (const absl::Status written = write_file_atomically(file, script_bytes(seeds[s])); !written.ok())
            return std::fprintf(stderr, "%s\n", std::string(written.message()).c_str()), 1;
    }
}
