#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <regex>
#include <set>

#include "common/files.h"
#include "server/config/daemon_config.h"
#include "server/pipeline/pipeline.h"
#include "tests/support/temporary_folder.h"

namespace kinevox {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;

const std::filesystem::path kExample = std::filesystem::path(KINEVOX_SOURCE_DIR) / "deploy/kinevoxd.toml";

TEST(Config, ExampleHoldsTheDefaults) {
    const auto config = read_config(kExample);
    ASSERT_TRUE(config.ok()) << config.status();
    EXPECT_EQ(*config, DaemonConfig{});
    EXPECT_EQ(*parse_config_toml("", "/", "empty", true), DaemonConfig{});
}

// Asks the reader for the keys it knows by misspelling one in each table, and looks each up in the example.
TEST(Config, ExampleDocumentsEveryKey) {
    const std::string example = *read_file(kExample);
    const std::set<std::string> tables{"studio", "cameras", "camera", "limits", "tracking", "fit", "filter"};
    int keys = 0;
    for (const std::string table :
         {"server",       "server.limits", "source",      "source.studio", "source.cameras", "pipeline",
          "segmentation", "tracking",      "hull",        "colouring",     "pose",           "pose.tracking",
          "pose.fit",     "pose.filter",   "calibration", "recording",     "replay",         "stream",
          "control",      "metrics",       "log"}) {
        const std::size_t begin = example.find("\n[" + table + "]\n");
        ASSERT_NE(begin, std::string::npos) << table;
        const std::string section = example.substr(begin, example.find("\n[", begin + 1) - begin);
        const auto config = parse_config_toml("[" + table + "]\nno_such_key = 1\n", "/", "probe", false);
        const std::string message{config.status().message()};
        std::smatch found;
        ASSERT_TRUE(std::regex_search(message, found, std::regex("expected one of (.*);"))) << message;
        const std::string list = found[1];
        const std::regex word("[a-z_0-9]+");
        for (auto i = std::sregex_iterator(list.begin(), list.end(), word); i != std::sregex_iterator();
             ++i) {
            if (tables.contains(i->str())) continue;
            EXPECT_TRUE(std::regex_search(section, std::regex("\n(# )?" + i->str() + " = ")))
                << table << "." << i->str();
            ++keys;
        }
    }
    EXPECT_GE(keys, 120);
}

// The list beside an Options struct is the only declaration: reader, example and defaults come from it.
TEST(Config, ExampleHoldsEveryListedOption) {
    const std::string example = *read_file(kExample);
    int listed = 0;
    const auto check = [&](const std::string& table, const auto& options) {
        const std::size_t begin = example.find("\n[" + table + "]\n");
        ASSERT_NE(begin, std::string::npos) << table;
        const std::string section = example.substr(begin, example.find("\n[", begin + 1) - begin);
        // The comments as text, without the units in parentheses.
        const std::string comments = std::regex_replace(std::regex_replace(section, std::regex("\n# "), " "),
                                                        std::regex(R"( \([^()]*\))"), "");
        visit_options(options, [&](const kernels::OptionInfo& info, const auto& value) {
            std::smatch found;
            ASSERT_TRUE(
                std::regex_search(section, found, std::regex(fmt::format("\n(# )?{} = (.*)", info.key))))
                << table << "." << info.key;
            using Value = std::remove_cvref_t<decltype(value)>;
            if constexpr (std::is_same_v<Value, bool>)
                EXPECT_EQ(found[2], value ? "true" : "false") << info.key;
            else if constexpr (kernels::kIsNumber<Value>)
                EXPECT_EQ(static_cast<Value>(std::stod(found[2])), value) << info.key;
            else if constexpr (std::is_enum_v<Value>)
                EXPECT_EQ(found[2], fmt::format("\"{}\"", info.choices[static_cast<std::size_t>(value)]));
            else if constexpr (std::is_same_v<Value, kernels::Device>)
                EXPECT_EQ(found[2], fmt::format("\"{}\"", kernels::name_of(value)));
            else  // the example shows a path or name where the default is empty
                EXPECT_EQ(found[1].matched, value == Value{} && found[2] != "\"\"") << info.key;
            for (const std::string_view choice : info.choices)
                EXPECT_THAT(comments, HasSubstr(choice)) << table << "." << info.key;
            std::string help = info.help;
            ASSERT_TRUE(help.ends_with('.')) << info.key;
            help.pop_back();
            EXPECT_THAT(comments, HasSubstr(help)) << table << "." << info.key;
            ++listed;
        });
    };
    const PipelineOptions pipeline;
    const DaemonConfig config;
    visit_option_tables(pipeline, check);
    visit_config_tables(config, check);
    EXPECT_GT(listed, 125);
}

TEST(Config, AcceptsEveryListedChoice) {
    int choices = 0;
    const DaemonConfig defaults;
    const auto check = [&](const std::string& table, const auto& options) {
        visit_options(options, [&](const kernels::OptionInfo& info, const auto&) {
            for (const std::string_view choice : info.choices) {
                const auto config = parse_config_toml(
                    fmt::format("[{}]\n{} = '{}'\n", table, info.key, choice), "/", "probe", false);
                EXPECT_THAT(std::string(config.status().message()),
                            ::testing::Not(HasSubstr(fmt::format("'{}.{}'", table, info.key))));
                ++choices;
            }
        });
    };
    visit_config_tables(defaults, check);
    const PipelineOptions pipeline;
    visit_option_tables(pipeline, check);
    EXPECT_EQ(
        parse_config_toml("[source.studio]\nmotion = 'get_up'\n", "/", "probe", false)->source.studio.motion,
        "get_up");
    EXPECT_EQ(parse_config_toml("[source.cameras]\ntrigger = 'free_run'\n", "/", "probe", false)
                  ->source.cameras.trigger,
              LiveSourceConfig::Trigger::kFreeRun);
    EXPECT_GE(choices, 31);
}

// A value just outside each listed range is refused, by the reader as by `kinevox process`.
TEST(Config, RefusesValuesOutsideEveryListedRange) {
    const DaemonConfig defaults;
    visit_config_tables(defaults, [](const std::string& table, const auto& options) {
        visit_options(options, [&](const kernels::OptionInfo& info, const auto& value) {
            const auto refuses = [&](const std::string& bad) {
                const auto config = parse_config_toml(fmt::format("[{}]\n{} = {}\n", table, info.key, bad),
                                                      "/", "probe", false);
                EXPECT_THAT(std::string(config.status().message()), HasSubstr(info.key)) << bad;
            };
            if constexpr (kernels::kIsNumber<std::remove_cvref_t<decltype(value)>>)
                for (const double bad : {info.min - 1, info.max + 1}) refuses(fmt::format("{:.0f}", bad));
            if (!info.choices.empty()) refuses("'no_such_choice'");
        });
    });
    EXPECT_THAT(kernels::check_ranges(PipelineConfig{.voxel_mm = 1}), HasSubstr("2 to 100"));
    EXPECT_EQ(kernels::check_ranges(PipelineConfig{}), "");
}

TEST(Config, ReadsDeviceNamesAndRefusesOthers) {
    const auto read = [](const std::string& value) {
        return parse_config_toml("[pipeline]\ndevice = " + value + "\n", "/", "probe", false);
    };
    EXPECT_EQ(read("'cpu'")->pipeline.device, kernels::Device::kCpu);
    EXPECT_EQ(read("'cuda'")->pipeline.device, kernels::Device::cuda(0));
    EXPECT_EQ(read("'cuda:0'")->pipeline.device, kernels::Device::cuda(0));
    EXPECT_EQ(read("'cuda:12'")->pipeline.device, kernels::Device::cuda(12));
    for (const char* name :
         {"gpu", "", "CUDA", "cuda:", "cuda:-1", "cuda:01", "cuda:1x", "cuda:1000", "cuda 1"})
        EXPECT_THAT(
            std::string(read(fmt::format("'{}'", name)).status().message()),
            ::testing::AllOf(HasSubstr("probe:2"), HasSubstr("'pipeline.device'"),
                             HasSubstr(fmt::format("is '{}'; use cpu, cuda or cuda:N; `kinevox devices` "
                                                   "lists them",
                                                   name))))
            << name;
    EXPECT_THAT(std::string(read("1").status().message()), HasSubstr("'pipeline.device'"));
}

TEST(Config, ReadsOptionsOfEveryPart) {
    const auto config = parse_config_toml(
        "[segmentation]\nloose_threshold = 0.25\n[tracking]\nconfirm_s = 0.1\n[hull]\nmin_views = 3\n"
        "[colouring]\nnoise_grey = 5\n[pose]\nfiltered = false\n[pose.fit]\nwide_steps = 2\n",
        "/", "probe", false);
    ASSERT_TRUE(config.ok()) << config.status();
    const auto options = pipeline_options(*config);
    ASSERT_TRUE(options.ok()) << options.status();
    EXPECT_EQ(options->segmentation.loose_threshold, 0.25f);
    EXPECT_EQ(options->tracker.confirm_s, 0.1);
    EXPECT_EQ(options->hull.min_views, 3);
    EXPECT_EQ(options->colour.noise_grey, 5);
    EXPECT_FALSE(options->posing.filtered);
    EXPECT_EQ(options->posing.tracker.fit.wide_steps, 2);
    EXPECT_THAT(
        std::string(parse_config_toml("[hull]\nmin_views = 0\n", "/", "k.toml", false).status().message()),
        AllOf(HasSubstr("k.toml:2"), HasSubstr("hull.min_views"), HasSubstr("1 to 64")));
}

TEST(Config, ReadsWhomToFollow) {
    const auto config = parse_config_toml(
        "[tracking]\nfollow = 'nearest'\nfollow_point_m = [1, -2]\n"
        "capture_region = [{ corners_m = [[0, 0], [2, 0], [1, 2]] }]\n"
        "[[tracking.keep_out_region]]\ncorners_m = [[5, 5], [6, 5], [6, 6], [5, 6]]\n",
        "/", "probe", false);
    ASSERT_TRUE(config.ok()) << config.status();
    const auto options = pipeline_options(*config);
    ASSERT_TRUE(options.ok()) << options.status();
    const SubjectRules& rules = options->tracker.rules;
    EXPECT_EQ(rules.follow, SubjectRules::Follow::kNearest);
    EXPECT_EQ(rules.point, (Vec2{1, -2}));
    EXPECT_EQ(rules.capture_regions, (std::vector{FloorRegion{{{0, 0}, {2, 0}, {1, 2}}}}));
    ASSERT_EQ(rules.keep_out_regions.size(), 1u);
    EXPECT_EQ(rules.keep_out_regions[0].corners.size(), 4u);
    EXPECT_TRUE(options->tracker.whole_scene()) << "people are separated even if one is followed";
    EXPECT_FALSE(TrackerOptions{}.whole_scene());
    const auto message = [](const std::string& text) {
        return std::string(
            parse_config_toml("[tracking]\n" + text + "\n", "/", "k.toml", false).status().message());
    };
    EXPECT_THAT(message("follow = 'last'"), AllOf(HasSubstr("k.toml:2"), HasSubstr("first")));
    EXPECT_THAT(message("capture_region = [{ corners_m = [[0, 0], [1, 1]] }]"),
                AllOf(HasSubstr("k.toml:2"), HasSubstr("3 to 64 rows")));
    EXPECT_THAT(message("keep_out_region = [{ corners_m = [[0, 0], [2, 2], [2, 0], [0, 2.5]] }]"),
                AllOf(HasSubstr("corners_m"), HasSubstr("cross")));
}

TEST(Config, DefaultsArePipelineDefaults) {
    const auto options = pipeline_options(DaemonConfig{});
    ASSERT_TRUE(options.ok());
    const PipelineOptions defaults;
    EXPECT_EQ(options->voxel_m, defaults.voxel_m);
    EXPECT_EQ(options->segmentation, defaults.segmentation);
    EXPECT_EQ(options->tracker, defaults.tracker);
    EXPECT_EQ(options->hull, defaults.hull);
    EXPECT_EQ(options->colour, defaults.colour);
    EXPECT_EQ(options->posing, defaults.posing);
}

TEST(Config, NamesTheNewKeyForAnOldOne) {
    for (const RenamedKey& key : renamed_config_keys()) {
        const std::size_t dot = key.before.rfind('.');
        const std::string table(key.before.substr(0, dot)), name(key.before.substr(dot + 1));
        const std::string text = table == "source.cameras.camera"
                                     ? "[[source.cameras.camera]]\n" + name + " = 1\n"
                                     : "[" + table + "]\n" + name + " = 1\n";
        EXPECT_THAT(
            std::string(parse_config_toml(text, "/", "k.toml", false).status().message()),
            AllOf(HasSubstr("k.toml:2"), HasSubstr(fmt::format("'{}' is now '{}'", key.before, key.now))))
            << text;
        EXPECT_THAT(*read_file(kExample),
                    HasSubstr(std::string(key.now.substr(key.now.rfind('.') + 1)) + " = "));
    }
    // Although another key is missing, too.
    EXPECT_THAT(std::string(parse_config_toml("[source]\nkind = \"session\"\nsession = \"a.toml\"\n", "/",
                                              "k.toml", false)
                                .status()
                                .message()),
                HasSubstr("'source.session_file'"));
}

TEST(Config, ReadsReplayFolders) {
    const auto config =
        parse_config_toml("[replay]\nfolders = [\"trials\", \"/data\"]\n", "/rig", "probe", false);
    ASSERT_TRUE(config.ok()) << config.status();
    EXPECT_THAT(config->replay.folders, ::testing::ElementsAre("/rig/trials", "/data"));
    for (const char* bad : {"3", "[3]", "[\"\"]", "\"trials\""})
        EXPECT_TRUE(absl::IsInvalidArgument(
            parse_config_toml(std::string("[replay]\nfolders = ") + bad, "/", "probe", false).status()))
            << bad;
}

TEST(Config, ReadsAccessKeys) {
    const auto config = parse_config_toml(
        "[server]\nlisten = \"0.0.0.0:1\"\ntls_certificate_file = \"c.pem\"\ntls_key_file = "
        "\"/k.pem\"\ntls_client_ca_file = "
        "\"ca.pem\"\ntoken_file = \"t.toml\"\n"
        "audit_file = \"\"\n[server.limits]\nmax_streams = 7\nmax_requests_per_s = 2.5\n",
        "/rig", "probe", false);
    ASSERT_TRUE(config.ok()) << config.status();
    const AccessConfig& access = config->server.access;
    EXPECT_EQ(access.tls_certificate_file, "/rig/c.pem");
    EXPECT_EQ(access.tls_key_file, "/k.pem");
    EXPECT_EQ(access.tls_client_ca_file, "/rig/ca.pem");
    EXPECT_EQ(access.token_file, "/rig/t.toml");
    EXPECT_EQ(access.audit_file, std::filesystem::path());
    EXPECT_EQ(access.max_streams, 7);
    EXPECT_EQ(access.max_requests_per_s, 2.5);
}

TEST(Config, RejectsIncompleteAccessKeys) {
    for (const char* text : {"tls_certificate_file = \"c.pem\"", "tls_key_file = \"k.pem\"",
                             "tls_client_ca_file = \"ca.pem\"", "token = \"t.toml\"", "limits = 3",
                             "[server.limits]\nmax_streams = 0", "[server.limits]\nmax_requests_per_s = 0.5"})
        EXPECT_TRUE(absl::IsInvalidArgument(
            parse_config_toml("[server]\n" + std::string(text) + "\n", "/rig", "probe", false).status()))
            << text;
    EXPECT_TRUE(absl::IsNotFound(
        parse_config_toml("[server]\ntoken_file = \"none.toml\"\n", "/nowhere", "probe", true).status()));
}

constexpr char kCameras[] = R"([source]
kind = "cameras"
[source.cameras]
calibration_file = "calibration.toml"
fps = 60
trigger = "camera"
trigger_camera = "left"
exposure_us = 4000
[[source.cameras.camera]]
name = "left"
device = "F1"
[[source.cameras.camera]]
name = "right"
device = "F2"
exposure_us = 5000
sensor_offset_px = [64, 32]
)";

TEST(Config, ReadsLiveCameras) {
    const auto config = parse_config_toml(kCameras, "/rig", "probe", false);
    ASSERT_TRUE(config.ok()) << config.status();
    EXPECT_EQ(config->source.kind, SourceConfig::Kind::kCameras);
    const LiveSourceConfig& cameras = config->source.cameras;
    EXPECT_EQ(cameras.calibration_file, "/rig/calibration.toml");
    EXPECT_EQ(cameras.trigger, LiveSourceConfig::Trigger::kCamera);
    ASSERT_EQ(cameras.cameras.size(), 2u);
    EXPECT_EQ(cameras.cameras[0].settings.exposure_us, 4000) << "that of all";
    EXPECT_EQ(cameras.cameras[1].settings.exposure_us, 5000) << "its own";
    EXPECT_EQ(cameras.cameras[1].settings.sensor_offset_px, (std::array<int, 2>{64, 32}));
}

TEST(Config, RejectsInvalidLiveCameras) {
    const struct {
        const char *what, *instead, *said;
    } kTable[] = {
        {"calibration_file = \"calibration.toml\"", "", "calibration_file"},
        {"\"right\"", "\"left\"", "occurs twice"},
        {"\"F2\"", "\"F1\"", "occurs twice"},
        {"trigger_camera = \"left\"", "trigger_camera = \"centre\"", "centre"},
        {"\"camera\"", "\"sometimes\"", "trigger"},
        {"fps = 60", "fps = 0", "fps"},
        {"exposure_us = 5000", "exposure_us = -1", "exposure_us"},
        {"exposure_us = 5000", "shutter = 3", "shutter"},
        {"[64, 32]", "[64]", "sensor_offset_px"},
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
session_file = "trial/session.toml"
pacing = "as_fast_as_possible"
loop = false
[source.studio]
motion = "sprint_start"
fps = 60
[pipeline]
device = "cuda:1"
voxel_mm = 5
[pose]
database_file = "poses.kvxposes"
library_pose_count = 30
[log]
level = "debug"
file = "kinevoxd.log"
)");
    const auto config = read_config(file);
    ASSERT_TRUE(config.ok()) << config.status();
    EXPECT_EQ(config->server.listen, "[::1]:0");
    EXPECT_EQ(config->source.kind, SourceConfig::Kind::kSession);
    EXPECT_EQ(config->source.session_file, folder / "trial/session.toml");
    EXPECT_EQ(config->source.pacing, SourceConfig::Pacing::kAsFastAsPossible);
    EXPECT_FALSE(config->source.loop);
    EXPECT_EQ(config->source.studio.motion, "sprint_start");
    EXPECT_EQ(config->source.studio.fps, 60);
    EXPECT_EQ(config->pipeline.device, kernels::Device::cuda(1));
    EXPECT_EQ(config->pipeline.voxel_mm, 5);
    EXPECT_EQ(config->pose.database_file, folder / "poses.kvxposes");
    EXPECT_EQ(config->pose.library_pose_count, 30);
    EXPECT_EQ(parse_config_toml("[pose]\ndatabase_file = \"\"\n", "/", "empty", true)->pose.database_file, "")
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
