#include "common/config.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <regex>

#include "common/atomic_file.h"
#include "tests/unit/common/temporary_folder.h"

namespace kinevox {
namespace {

using ::testing::HasSubstr;

const std::filesystem::path kExample = std::filesystem::path(KINEVOX_SOURCE_DIR) / "deploy/kinevoxd.toml";

TEST(Config, TheExampleHoldsTheDefaults) {
    const auto config = read_config(kExample);
    ASSERT_TRUE(config.ok()) << config.status();
    EXPECT_EQ(*config, DaemonConfig{});
    EXPECT_EQ(*parse_config_toml("", "/", "empty", true), DaemonConfig{});
}

// Asks the reader for the keys it knows by misspelling one in each table, and looks each up in the example.
TEST(Config, TheExampleExplainsEveryKey) {
    const std::string example = *read_file(kExample);
    int keys = 0;
    for (const std::string table : {"server", "server.limits", "source", "source.studio", "source.cameras",
                                    "pipeline", "segmentation", "pose", "stream", "control", "log"}) {
        const auto config = parse_config_toml("[" + table + "]\nno_such_key = 1\n", "/", "probe", false);
        const std::string message{config.status().message()};
        std::smatch found;
        ASSERT_TRUE(std::regex_search(message, found, std::regex("expected one of (.*);"))) << message;
        const std::string list = found[1];
        const std::regex word("[a-z_]+");
        for (auto i = std::sregex_iterator(list.begin(), list.end(), word); i != std::sregex_iterator();
             ++i) {
            if (i->str() == "studio" || i->str() == "cameras" || i->str() == "camera" || i->str() == "limits")
                continue;  // a table of its own
            EXPECT_TRUE(std::regex_search(example, std::regex("\n(# )?" + i->str() + " = "))) << i->str();
            ++keys;
        }
    }
    EXPECT_GE(keys, 20);
}

TEST(Config, ReadsWhoMayDoWhat) {
    const auto config = parse_config_toml(
        "[server]\nlisten = \"0.0.0.0:1\"\ncertificate = \"c.pem\"\nkey = \"/k.pem\"\nclient_ca = "
        "\"ca.pem\"\ntokens = \"t.toml\"\n"
        "audit = \"\"\n[server.limits]\nmax_streams = 7\nrequests_per_s = 2.5\n",
        "/rig", "probe", false);
    ASSERT_TRUE(config.ok()) << config.status();
    const AccessConfig& access = config->server.access;
    EXPECT_EQ(access.certificate, "/rig/c.pem");
    EXPECT_EQ(access.key, "/k.pem");
    EXPECT_EQ(access.client_ca, "/rig/ca.pem");
    EXPECT_EQ(access.tokens, "/rig/t.toml");
    EXPECT_EQ(access.audit, std::filesystem::path());
    EXPECT_EQ(access.max_streams, 7);
    EXPECT_EQ(access.requests_per_s, 2.5);
}

TEST(Config, HalfOfWhoMayDoWhatIsTold) {
    for (const char* text :
         {"certificate = \"c.pem\"", "key = \"k.pem\"", "client_ca = \"ca.pem\"", "token = \"t.toml\"",
          "limits = 3", "[server.limits]\nmax_streams = 0", "[server.limits]\nrequests_per_s = 0.5"})
        EXPECT_TRUE(absl::IsInvalidArgument(
            parse_config_toml("[server]\n" + std::string(text) + "\n", "/rig", "probe", false).status()))
            << text;
    EXPECT_TRUE(absl::IsNotFound(
        parse_config_toml("[server]\ntokens = \"none.toml\"\n", "/nowhere", "probe", true).status()));
}

constexpr char kCameras[] = R"([source]
kind = "cameras"
[source.cameras]
calibration = "calibration.toml"
fps = 60
trigger = "master"
master = "left"
exposure_us = 4000
[[source.cameras.camera]]
name = "left"
device = "F1"
[[source.cameras.camera]]
name = "right"
device = "F2"
exposure_us = 5000
offset_px = [64, 32]
)";

TEST(Config, ReadsLiveCameras) {
    const auto config = parse_config_toml(kCameras, "/rig", "probe", false);
    ASSERT_TRUE(config.ok()) << config.status();
    EXPECT_EQ(config->source.kind, SourceConfig::Kind::kCameras);
    const LiveCamerasConfig& cameras = config->source.cameras;
    EXPECT_EQ(cameras.calibration, "/rig/calibration.toml");
    EXPECT_EQ(cameras.trigger, LiveCamerasConfig::Trigger::kMaster);
    ASSERT_EQ(cameras.cameras.size(), 2u);
    EXPECT_EQ(cameras.cameras[0].settings.exposure_us, 4000) << "that of all";
    EXPECT_EQ(cameras.cameras[1].settings.exposure_us, 5000) << "its own";
    EXPECT_EQ(cameras.cameras[1].settings.offset_px, (std::array<int, 2>{64, 32}));
}

TEST(Config, LiveCamerasThatCannotBeAreToldWithTheKey) {
    const struct {
        const char *what, *instead, *said;
    } kTable[] = {
        {"calibration = \"calibration.toml\"", "", "calibration"},
        {"\"right\"", "\"left\"", "stands there twice"},
        {"\"F2\"", "\"F1\"", "stands there twice"},
        {"master = \"left\"", "master = \"middle\"", "middle"},
        {"\"master\"", "\"sometimes\"", "trigger"},
        {"fps = 60", "fps = 0", "fps"},
        {"exposure_us = 5000", "exposure_us = -1", "exposure_us"},
        {"exposure_us = 5000", "shutter = 3", "shutter"},
        {"[64, 32]", "[64]", "offset_px"},
    };
    for (const auto& row : kTable) {
        std::string text = kCameras;
        text.replace(text.find(row.what), std::string(row.what).size(), row.instead);
        const auto config = parse_config_toml(text, "/rig", "probe", false);
        ASSERT_FALSE(config.ok()) << row.instead;
        EXPECT_THAT(std::string(config.status().message()), HasSubstr(row.said)) << row.instead;
    }
    const auto missing = parse_config_toml(kCameras, "/rig", "probe", true);
    EXPECT_TRUE(absl::IsNotFound(missing.status())) << missing.status();
}

TEST(Config, ReadsEveryKind) {
    const testing::TemporaryFolder folder;
    folder.write("trial/session.toml", "");
    const auto file = folder.write("kinevoxd.toml", R"(
[server]
listen = "[::1]:0"
[source]
kind = "session"
session = "trial/session.toml"
pacing = "as_fast_as_possible"
loop = false
[source.studio]
motion = "sprint_start"
fps = 60
[pipeline]
device = "cuda"
voxel_mm = 5
[pose]
database = "poses.kvxposes"
database_poses = 30
[log]
level = "debug"
file = "kinevoxd.log"
)");
    const auto config = read_config(file);
    ASSERT_TRUE(config.ok()) << config.status();
    EXPECT_EQ(config->server.listen, "[::1]:0");
    EXPECT_EQ(config->source.kind, SourceConfig::Kind::kSession);
    EXPECT_EQ(config->source.session, folder / "trial/session.toml");
    EXPECT_EQ(config->source.pacing, SourceConfig::Pacing::kAsFastAsPossible);
    EXPECT_FALSE(config->source.loop);
    EXPECT_EQ(config->source.studio.motion, "sprint_start");
    EXPECT_EQ(config->source.studio.fps, 60);
    EXPECT_EQ(config->pipeline.device, PipelineConfig::Device::kCuda);
    EXPECT_EQ(config->pipeline.voxel_mm, 5);
    EXPECT_EQ(config->pose.database, folder / "poses.kvxposes");
    EXPECT_EQ(config->pose.database_poses, 30);
    EXPECT_EQ(parse_config_toml("[pose]\ndatabase = \"\"\n", "/", "empty", true)->pose.database, "")
        << "none, which is not the default";
    EXPECT_EQ(config->log.file, folder / "kinevoxd.log");
}

TEST(Config, ListenAddresses) {
    for (const char* good : {"127.0.0.1:50770", "localhost:1", "0.0.0.0:0", "[::]:50770"})
        EXPECT_EQ(listen_address_problem(good), "") << good;
    for (const char* bad : {"", ":", "50770", "localhost", "localhost:", "localhost:http", "localhost:65536",
                            "localhost:-1", "::1:50770", "local host:5", ":50770"})
        EXPECT_NE(listen_address_problem(bad), "") << bad;
}

}  // namespace
}  // namespace kinevox
