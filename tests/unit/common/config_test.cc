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
    for (const std::string table :
         {"server", "source", "source.studio", "pipeline", "segmentation", "pose", "stream", "control", "log"}) {
        const auto config = parse_config_toml("[" + table + "]\nno_such_key = 1\n", "/", "probe", false);
        const std::string message{config.status().message()};
        std::smatch found;
        ASSERT_TRUE(std::regex_search(message, found, std::regex("expected one of (.*);"))) << message;
        const std::string list = found[1];
        const std::regex word("[a-z_]+");
        for (auto i = std::sregex_iterator(list.begin(), list.end(), word); i != std::sregex_iterator();
             ++i) {
            if (i->str() == "studio") continue;  // a table of its own
            EXPECT_TRUE(std::regex_search(example, std::regex("\n(# )?" + i->str() + " = "))) << i->str();
            ++keys;
        }
    }
    EXPECT_GE(keys, 20);
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
