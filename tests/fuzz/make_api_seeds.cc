// usage: make_api_seeds FOLDER
// Writes scripts for api_fuzzer to start from: two of every method with fields as chance wills, the same each
// time, and the ways that a client goes.
#include <cstdio>
#include <random>
#include <string>
#include <vector>

#include "common/atomic_file.h"
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

// The steps' methods; the requests are what chance and the lease make of them.
std::vector<Step> way(const std::vector<std::string>& names, std::mt19937& random) {
    std::vector<Step> steps;
    for (const std::string& name : names) {
        Step step = random_step(number_of(name), random);
        step.who = Who::kAdminister;
        step.frame_sets = 3;
        if (!step.called().streams) step.ending = Ending::kRead;
        if (name == "Start" || name == "Stop" || name == "StartRecording" || name == "StopRecording") {
            v1::StopRecordingRequest lease;  // field 1 is the lease in all of these
            lease.set_lease_id(kLeaseWord);
            step.request = lease.SerializeAsString();
        }
        if (name == "OpenReplay") {
            v1::OpenReplayRequest request;
            request.set_lease_id(kLeaseWord);
            request.set_session("seed");
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
    const std::vector<std::string> ways[] = {
        {"Start", "StreamVolumes", "StreamPoses", "StreamPreviews", "WatchEvents", "LearnBackground", "Stop"},
        {"Start", "StartRecording", "GetRecorderStatus", "StopRecording", "ListRecordings", "Export",
         "DeleteRecording"},
        {"OpenReplay", "Start", "SetReplay", "StreamPoses", "GetReplay", "SetReplay", "CloseReplay"},
        {"ImportCalibration", "ListCalibrations", "ApplyCalibration", "ExportCalibration", "UndoCalibration",
         "RemoveCalibration"},
        {"StartProcedure", "AddObservations", "WatchProcedure", "SolveProcedure", "CancelProcedure"},
        {"Start", "StartProcedure", "AddObservations", "AddObservations", "SolveProcedure", "Stop"},
        {"AddPose", "ImportBvh", "ListPoses", "RemovePose", "FitBody", "WatchBody"},
        {"AcquireControl", "RenewControl", "KeepLast", "ReleaseControl", "GetStatus"}};
    for (const auto& names : ways)
        for (int i = 0; i < 3; ++i) seeds.push_back(way(names, random));
    for (std::size_t s = 0; s < seeds.size(); ++s) {
        const auto file = std::filesystem::path(argv[1]) / ("seed" + std::to_string(s));
        if (const absl::Status written = write_file_atomically(file, script_bytes(seeds[s])); !written.ok())
            return std::fprintf(stderr, "%s\n", std::string(written.message()).c_str()), 1;
    }
}
