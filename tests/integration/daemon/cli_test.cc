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
    EXPECT_THAT(again.errors, HasSubstr("runs already"));
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
        EXPECT_EQ(message["missed"], 0);
    }
    const auto csv =
        kinevox({"stream", "volumes", "--frames", "2", "--format", "csv", "--max-voxel-mm", "20"});
    ASSERT_EQ(lines(csv.output).size(), 3u) << csv.errors;
    EXPECT_THAT(lines(csv.output)[0], StartsWith("frame,capture_time_ns,subject_id,voxel_mm,"));

    // The session's subject need not be found for the columns to be those of the files.
    const auto angles = lines(kinevox({"stream", "angles", "--frames", "2", "--format", "csv"}).output);
    ASSERT_EQ(angles.size(), 3u);
    EXPECT_THAT(angles[0], StartsWith("frame,time_s,knee_flexion_l_deg,knee_flexion_r_deg,"));
    const auto joints = lines(kinevox({"stream", "joints", "--frames", "2", "--format", "csv"}).output);
    ASSERT_EQ(joints.size(), 3u);
    EXPECT_THAT(joints[0], StartsWith("frame,time_s,root_x,root_y,root_z,sacroiliac_x,"));
    EXPECT_EQ(std::ranges::count(joints[1], ','), 61);
    EXPECT_TRUE(json::parse(kinevox({"stream", "angles", "--frames", "1"}).output).contains("angles"));

    const auto plys = folder_.path() / "plys";
    ASSERT_EQ(
        kinevox({"stream", "volumes", "--frames", "3", "--format", "ply-folder", "--out", plys.string()})
            .status,
        0);
    EXPECT_EQ(std::distance(std::filesystem::directory_iterator(plys), {}), 3);

    EXPECT_THAT(kinevox({"watch", "--count", "2", "--interval", "0.1"}).output, HasSubstr("running frame"));
    EXPECT_EQ(json::parse(kinevox({"cameras", "--json"}).output).size(), 4u);
    EXPECT_THAT(kinevox({"events", "--count", "1", "--past", "100"}).output, HasSubstr("has control"));

    const auto shots = folder_.path() / "shots";
    const auto snapshot = kinevox({"snapshot", "--out", shots.string(), "--camera", "cam2"});
    EXPECT_EQ(snapshot.status, 0) << snapshot.errors;
    EXPECT_TRUE(std::filesystem::exists(shots / "volume.ply"));
    EXPECT_GT(std::filesystem::file_size(shots / "snapshot.png"), 10'000u);

    EXPECT_EQ(kinevox({"stop"}).output, "stopped\n");
    EXPECT_EQ(kinevox({"learn-background"}).output, "learned\n");
}

TEST_F(CliTest, PosesAreListedAddedImportedAndRemoved) {
    const auto daemon = start_daemon(session_config("127.0.0.1:0", "autostart = false\n",
                                                    "database = \"poses.kvxposes\"\ndatabase_poses = 12"));
    const auto watched = kinevox({"poses", "watch"});
    EXPECT_EQ(watched.status, 0) << watched.errors;
    EXPECT_THAT(lines(watched.output).back(), StartsWith("ready, 864 entries"));
    EXPECT_EQ(json::parse(kinevox({"poses", "list", "--json"}).output)["poses"].size(), 12u);

    EXPECT_EQ(
        kinevox({"poses", "add", "sitting", "--set", "knee_angle_l=90", "--set", "knee_angle_r=90"}).output,
        "added; 936 entries\n");
    const auto file = write("kick.bvh", testing::small_bvh(3));
    EXPECT_EQ(json::parse(kinevox({"poses", "import", file.string(), "--json"}).output)["poses"], 3);
    EXPECT_EQ(lines(kinevox({"poses", "list", "--added"}).output),
              (std::vector<std::string>{"added  sitting", "added  kick, 0.00 s", "added  kick, 0.10 s",
                                        "added  kick, 0.20 s"}));
    EXPECT_EQ(kinevox({"poses", "remove", "sitting"}).output, "removed; 1080 entries\n");

    for (const std::vector<std::string>& wrong :
         std::vector<std::vector<std::string>>{{"poses", "remove", "sitting"},
                                               {"poses", "add", "x", "--set", "knee"},
                                               {"poses", "add", "x"},
                                               {"poses", "import", "/nowhere.bvh"},
                                               {"poses"}}) {
        const auto ran = kinevox(wrong);
        EXPECT_EQ(ran.status, 1);
        EXPECT_EQ(lines(ran.errors).size(), 1u) << ran.errors;
    }
}

TEST_F(CliTest, FitsTheBodyOfWhoIsSeen) {
    const auto daemon =
        start_daemon(session_config("127.0.0.1:0", "autostart = false\n",
                                    "database = \"\"\nfit_body = false\nfitted_body = \"kept/body.toml\""));
    const auto stopped = kinevox({"body", "fit"});
    EXPECT_EQ(stopped.status, 1);
    EXPECT_THAT(stopped.errors, HasSubstr("does not run"));
    const auto average = kinevox({"body", "show"});
    EXPECT_THAT(lines(average.output)[1], HasSubstr("stature"));
    EXPECT_THAT(average.output, Not(HasSubstr("+-"))) << "of nobody";

    ASSERT_EQ(kinevox({"start"}).status, 0);
    const auto fitted = kinevox({"body", "fit", "--seconds", "1", "--json"});
    ASSERT_EQ(fitted.status, 0) << fitted.errors;
    const json last = json::parse(lines(fitted.output).back());
    EXPECT_EQ(last["state"], "ready") << last.dump();
    EXPECT_GT(last["body"]["stature"]["std_m"], 0);
    EXPECT_TRUE(std::filesystem::exists(folder_.path() / "kept/body.toml")) << last.dump();
    EXPECT_THAT(kinevox({"body", "show"}).output, HasSubstr("+-"));
    EXPECT_THAT(last["message"].get<std::string>(), HasSubstr("stored in"));
    EXPECT_EQ(kinevox({"status"}).status, 0) << "it runs on";

    // What was kept is what the next daemon begins with.
    daemon->signal(SIGTERM);
    EXPECT_EQ(daemon->wait(std::chrono::milliseconds(2000)), 0) << daemon->errors();
    const auto next = start_daemon(
        session_config("127.0.0.1:0", "autostart = false\n", "database = \"\"\nbody = \"kept/body.toml\""));
    EXPECT_EQ(json::parse(kinevox({"body", "show", "--json"}).output)["body"]["stature"]["value_m"],
              last["body"]["stature"]["value_m"]);
}

TEST_F(CliTest, SaysWhatIsWrongInOneLine) {
    address_ = "127.0.0.1:1";
    const struct {
        std::vector<std::string> arguments;
        const char* said;
    } kTable[] = {
        {{"status"}, "cannot reach a daemon at 127.0.0.1:1"},
        {{"stream", "volumes"}, "cannot reach a daemon at 127.0.0.1:1"},
        {{"watch"}, "cannot reach a daemon"},
        {{"stream", "volumes", "--format", "xml"}, "xml"},
        {{"stream", "volumes", "--format", "ply-folder"}, "--out"},
        {{"stream", "volumes", "--frames", "-1"}, "-1"},
        {{"juggle"}, "no verb 'juggle'"},
        {{"status", "--jsn"}, "--jsn"},
        {{"snapshot"}, "--out"},
        {{}, "subcommand"},
    };
    for (const auto& row : kTable) {
        const auto ran = kinevox(row.arguments);
        EXPECT_EQ(ran.status, 1) << row.said;
        EXPECT_THAT(ran.errors, HasSubstr(row.said));
        EXPECT_EQ(lines(ran.errors).size(), 1u) << ran.errors;
    }
}

TEST_F(CliTest, StartsToolsBesideItAndOnThePath) {
    const auto tool = write("kinevox-juggle", "#!/bin/sh\necho \"juggles $1 $2\"\nexit 7\n");
    std::filesystem::permissions(tool, std::filesystem::perms::owner_all);
    const std::vector<std::string> path{"PATH=" + folder_.path().string() + ":/usr/bin:/bin"};
    const auto ran = kinevox({"juggle", "--balls", "3"}, path);
    EXPECT_EQ(ran.output, "juggles --balls 3\n") << ran.errors;
    EXPECT_EQ(ran.status, 7) << "the tool's own status";
    EXPECT_THAT(kinevox({"--help"}, path).output, HasSubstr("juggle"));
}

TEST_F(CliTest, AStreamStopsOnSigintWithStatusZero) {
    const auto daemon = start_daemon(session_config("127.0.0.1:0"));
    testing::ChildProcess stream({KINEVOX_CLI, "stream", "volumes", "--server", address_}, folder_.path());
    EXPECT_THAT(stream.first_line(), StartsWith("{\"sequence\":"));
    stream.signal(SIGINT);
    EXPECT_EQ(stream.wait(std::chrono::seconds(5)), 0) << stream.errors();
    EXPECT_EQ(stream.output().back(), '\n') << "no half line";
}

}  // namespace
}  // namespace kinevox
