// `kinevox` against a real daemon.
#include <gmock/gmock.h>
#include <signal.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "tests/integration/daemon/daemon_fixture.h"
#include "tests/support/small_bvh.h"

namespace kinevox {
namespace {

using nlohmann::json;
using ::testing::HasSubstr;
using ::testing::StartsWith;

class CliTest : public testing::DaemonTest {
  protected:
    std::vector<std::string> lines(const std::string& text) {
        std::vector<std::string> out;
        std::istringstream in(text);
        for (std::string line; std::getline(in, line);) out.push_back(line);
        return out;
    }
};

TEST_F(CliTest, ControlsWatchesAndStreams) {
    const auto daemon = start_daemon(session_config(
        "127.0.0.1:0", "autostart = false\npacing = \"as_fast_as_possible\"\n"));  // loses no frame set

    EXPECT_EQ(json::parse(kinevox({"status", "--json"}).output)["state"], "stopped");
    EXPECT_EQ(kinevox({"start"}).output, "started\n");
    const auto again = kinevox({"start"});
    EXPECT_EQ(again.status, 1);
    EXPECT_THAT(again.errors, HasSubstr("is running already"));
    EXPECT_EQ(lines(again.errors).size(), 1u);

    const auto volumes = kinevox({"stream", "volumes", "--frames", "5", "--lossless"});
    ASSERT_EQ(volumes.status, 0) << volumes.errors;
    std::optional<std::uint64_t> sequence;
    ASSERT_EQ(lines(volumes.output).size(), 5u);
    for (const std::string& line : lines(volumes.output)) {
        const json message = json::parse(line);
        if (sequence) {
            EXPECT_EQ(message["sequence"], *sequence + 1);
        }
        sequence = message["sequence"].get<std::uint64_t>();
        EXPECT_EQ(message["missed_count"], 0);
    }
    const auto csv =
        kinevox({"stream", "volumes", "--frames", "2", "--format", "csv", "--max-voxel-mm", "20"});
    ASSERT_EQ(lines(csv.output).size(), 3u) << csv.errors;
    EXPECT_THAT(lines(csv.output)[0], StartsWith("frame,capture_time_ns,subject,sequence,voxel_mm,"));

    // The session's subject need not be found for the columns to be those of the files.
    const auto angles = lines(kinevox({"stream", "angles", "--frames", "2", "--format", "csv"}).output);
    ASSERT_EQ(angles.size(), 3u);
    EXPECT_THAT(angles[0], StartsWith("frame,time_s,subject,sequence,knee_flexion_geometric_l_deg,"));
    const auto joints = lines(kinevox({"stream", "joints", "--frames", "2", "--format", "csv"}).output);
    ASSERT_EQ(joints.size(), 3u);
    EXPECT_THAT(joints[0], StartsWith("frame,time_s,subject,sequence,root_x,root_y,root_z,sacroiliac_x,"));
    EXPECT_EQ(std::ranges::count(joints[1], ','), 63);
    const auto coordinates =
        lines(kinevox({"stream", "coordinates", "--frames", "2", "--format", "csv"}).output);
    ASSERT_EQ(coordinates.size(), 3u);
    EXPECT_THAT(coordinates[0], StartsWith("frame,time_s,subject,sequence,pelvis_x_m,"));
    EXPECT_EQ(std::ranges::count(coordinates[1], ','), 35);
    EXPECT_TRUE(json::parse(kinevox({"stream", "angles", "--frames", "1"}).output)["subjects"].is_array());

    const auto plys = folder_.path() / "plys";
    ASSERT_EQ(
        kinevox({"stream", "volumes", "--frames", "3", "--format", "ply-folder", "--out", plys.string()})
            .status,
        0);
    EXPECT_EQ(std::distance(std::filesystem::directory_iterator(plys), {}), 3);

    EXPECT_THAT(kinevox({"watch", "--count", "2", "--interval", "0.1"}).output, HasSubstr("running frame"));
    EXPECT_EQ(json::parse(kinevox({"cameras", "--json"}).output).size(), 4u);
    EXPECT_THAT(kinevox({"events", "--count", "1", "--history", "100"}).output,
                HasSubstr("control_acquired"));

    const auto shots = folder_.path() / "shots";
    const auto snapshot = kinevox({"snapshot", "--out", shots.string(), "--camera", "cam2"});
    EXPECT_EQ(snapshot.status, 0) << snapshot.errors;
    EXPECT_TRUE(std::filesystem::exists(shots / "volume.ply"));
    EXPECT_GT(std::filesystem::file_size(shots / "snapshot.png"), 10'000u);

    const auto again_shot = kinevox({"snapshot", "--out", shots.string()});
    EXPECT_EQ(again_shot.status, 1);
    EXPECT_THAT(again_shot.errors, HasSubstr("--overwrite"));

    EXPECT_EQ(kinevox({"stop"}).output, "stopped\n");
    EXPECT_EQ(kinevox({"learn-background"}).output, "learned\n");
}

TEST_F(CliTest, ManagesLibraryPoses) {
    const auto daemon = start_daemon(session_config(
        "127.0.0.1:0", "autostart = false\n", "database_file = \"poses.kvxposes\"\nlibrary_pose_count = 12"));
    const auto watched = kinevox({"poses", "watch"});
    EXPECT_EQ(watched.status, 0) << watched.errors;
    EXPECT_THAT(lines(watched.output).back(), StartsWith("ready, 864 entries"));
    EXPECT_EQ(json::parse(kinevox({"poses", "list", "--json"}).output)["poses"].size(), 12u);

    EXPECT_EQ(kinevox({"poses", "add", "sitting", "--coordinate", "knee_angle_l=90", "--coordinate",
                       "knee_angle_r=90"})
                  .output,
              "added; 936 entries\n");
    const auto file = write("kick.bvh", testing::small_bvh(3));
    EXPECT_EQ(json::parse(kinevox({"poses", "import", file.string(), "--json"}).output)["pose_count"], 3);
    EXPECT_EQ(lines(kinevox({"poses", "list", "--user"}).output),
              (std::vector<std::string>{"kind  label", "user  sitting", "user  kick, 0.00 s",
                                        "user  kick, 0.10 s", "user  kick, 0.20 s"}));
    const auto unconfirmed = kinevox({"poses", "delete", "sitting"});
    EXPECT_EQ(unconfirmed.status, 1);
    EXPECT_THAT(unconfirmed.errors, HasSubstr("--yes"));
    EXPECT_EQ(kinevox({"poses", "delete", "sitting", "--yes"}).output, "deleted; 1080 entries\n");

    for (const std::vector<std::string>& wrong :
         std::vector<std::vector<std::string>>{{"poses", "delete", "sitting", "--yes"},
                                               {"poses", "add", "x", "--coordinate", "knee"},
                                               {"poses", "add", "x"},
                                               {"poses", "import", "/nowhere.bvh"},
                                               {"poses"}}) {
        const auto ran = kinevox(wrong);
        EXPECT_EQ(ran.status, 1);
        EXPECT_EQ(lines(ran.errors).size(), 1u) << ran.errors;
    }
}

TEST_F(CliTest, FitsBodyOfSubject) {
    const auto daemon = start_daemon(
        session_config("127.0.0.1:0", "autostart = false\n",
                       "database_file = \"\"\nauto_fit_body = false\nfitted_body_file = \"kept/body.toml\""));
    const auto stopped = kinevox({"body", "fit"});
    EXPECT_EQ(stopped.status, 1);
    EXPECT_THAT(stopped.errors, HasSubstr("is not running"));
    const auto average = kinevox({"body", "show"});
    EXPECT_THAT(lines(average.output)[2], HasSubstr("stature"));
    EXPECT_TRUE(lines(average.output)[2].ends_with("-")) << "of no subject";

    ASSERT_EQ(kinevox({"start"}).status, 0);
    const auto fitted = kinevox({"body", "fit", "--duration", "1", "--json"});
    ASSERT_EQ(fitted.status, 0) << fitted.errors;
    const json last = json::parse(lines(fitted.output).back())["subjects"][0];
    EXPECT_EQ(last["state"], "ready") << last.dump();
    EXPECT_GT(last["body"]["stature"]["std_m"], 0);
    EXPECT_TRUE(std::filesystem::exists(folder_.path() / "kept/body.toml")) << last.dump();
    EXPECT_FALSE(lines(kinevox({"body", "show"}).output)[2].ends_with("-"));
    EXPECT_THAT(last["message"].get<std::string>(), HasSubstr("stored in"));
    EXPECT_EQ(kinevox({"status"}).status, 0) << "it runs on";

    // What was kept is what the next daemon begins with.
    daemon->signal(SIGTERM);
    EXPECT_EQ(daemon->wait(std::chrono::milliseconds(2000)), 0) << daemon->errors();
    const auto next = start_daemon(session_config("127.0.0.1:0", "autostart = false\n",
                                                  "database_file = \"\"\nbody_file = \"kept/body.toml\""));
    EXPECT_EQ(
        json::parse(kinevox({"body", "show", "--json"}).output)["subjects"][0]["body"]["stature"]["value_m"],
        last["body"]["stature"]["value_m"]);
}

TEST_F(CliTest, ReportsErrorsInOneLine) {
    address_ = "127.0.0.1:1";
    const struct {
        std::vector<std::string> arguments;
        const char* error;
    } kTable[] = {
        {{"status"}, "cannot connect to a daemon at 127.0.0.1:1"},
        {{"stream", "volumes"}, "cannot connect to a daemon at 127.0.0.1:1"},
        {{"watch"}, "cannot connect to a daemon"},
        {{"stream", "volumes", "--format", "xml"}, "xml"},
        {{"stream", "volumes", "--format", "ply-folder"}, "--out"},
        {{"stream", "volumes", "--frames", "-1"}, "-1"},
        {{"juggle"}, "unknown command 'juggle'"},
        {{"statsu"}, "did you mean 'status'?"},
        {{"record", "delte", "x"}, "unknown record command 'delte'; did you mean 'delete'?"},
        {{"record", "delete", "x"}, "--yes"},
        {{"stream", "angles", "--max-rte", "3"}, "did you mean '--max-rate'?"},
        {{"status", "--jsn"}, "unknown option '--jsn'; did you mean '--json'?"},
        {{"snapshot"}, "--out"},
        {{}, "subcommand"},
    };
    for (const auto& row : kTable) {
        const auto ran = kinevox(row.arguments);
        EXPECT_EQ(ran.status, 1) << row.error;
        EXPECT_THAT(ran.errors, HasSubstr(row.error));
        EXPECT_EQ(lines(ran.errors).size(), 1u) << ran.errors;
    }
}

TEST_F(CliTest, StartsToolsFromFolderAndPath) {
    const auto tool = write("kinevox-juggle", "#!/bin/sh\necho \"juggles $1 $2\"\nexit 7\n");
    std::filesystem::permissions(tool, std::filesystem::perms::owner_all);
    const std::vector<std::string> path{"PATH=" + folder_.path().string() + ":/usr/bin:/bin"};
    const auto ran = kinevox({"juggle", "--balls", "3"}, path);
    EXPECT_EQ(ran.output, "juggles --balls 3\n") << ran.errors;
    EXPECT_EQ(ran.status, 7) << "the tool's own status";
    EXPECT_THAT(kinevox({"--help"}, path).output, HasSubstr("juggle"));
}

TEST_F(CliTest, StopsStreamOnSigint) {
    const auto daemon = start_daemon(session_config("127.0.0.1:0"));
    testing::ChildProcess stream({KINEVOX_CLI, "stream", "volumes", "--server", address_}, folder_.path());
    EXPECT_THAT(stream.first_line(), StartsWith("{\"sequence\":"));
    stream.signal(SIGINT);
    EXPECT_EQ(stream.wait(std::chrono::seconds(5)), 0) << stream.errors();
    EXPECT_EQ(stream.output().back(), '\n') << "no half line";
}

}  // namespace
}  // namespace kinevox
