// What users get wrong, given to the real programs: each ends with status 1 and exactly one line on standard
// error that names the input, and leaves nothing behind. The readers' own tables are in tests/unit, a port in
// use is in daemon_test.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <signal.h>
#include <sys/stat.h>

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <functional>
#include <nlohmann/json.hpp>
#include <sstream>
#include <thread>

#include "tests/support/child_process.h"
#include "tests/support/small_session.h"

namespace kinevox {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;
using testing::Ran;

std::string contents(const fs::path& file) {
    std::ifstream in(file, std::ios::binary);
    std::ostringstream out;
    out << in.rdbuf();
    return out.str();
}

void write(const fs::path& file, const std::string& text) {
    std::ofstream(file, std::ios::binary) << text;
}

// In the file, the first `from` becomes `to`.
void edit(const fs::path& file, const std::string& from, const std::string& to) {
    std::string text = contents(file);
    const auto at = text.find(from);
    ASSERT_NE(at, std::string::npos) << from << " is not in " << file;
    write(file, text.replace(at, from.size(), to));
}

// As a copy that broke off: the index of frames, which stands at the file's end, is lost.
void cut(const fs::path& video, double kept) {
    fs::resize_file(video, static_cast<std::uintmax_t>(kept * static_cast<double>(fs::file_size(video))));
}

// The container stays whole, its images do not.
void spoil_images(const fs::path& video) {
    std::string bytes = contents(video);
    const auto begin = bytes.find("mdat"), end = bytes.find("moov");
    ASSERT_TRUE(begin != std::string::npos && end != std::string::npos && begin < end);
    for (auto i = begin + 8; i + 8 < end; ++i) bytes[i] = static_cast<char>(bytes[i] ^ 0x5a);
    write(video, bytes);
}

class BadInputTest : public ::testing::Test {
  protected:
    static void SetUpTestSuite() {
        shared_ = new testing::TemporaryFolder;
        const Ran made = testing::run(
            {KINEVOX_STUDIO, "--motion", "walk", "--frames", "3", "--size", "160x120", "--background-frames",
             "8", "--no-masks", "--out", (shared_->path() / "good").string()},
            shared_->path());
        ASSERT_EQ(made.status, 0) << made.errors;
    }
    static void TearDownTestSuite() {
        delete shared_;
        shared_ = nullptr;
    }

    // A session to spoil.
    fs::path fresh_session() {
        const fs::path folder = folder_.path() / fmt::format("session{}", sessions_++);
        fs::copy(shared_->path() / "good", folder, fs::copy_options::recursive);
        return folder;
    }

    void expect_refused(const std::string& what, const std::vector<std::string>& command,
                        const std::vector<std::string>& words) {
        SCOPED_TRACE(what);
        const Ran ran = testing::run(command, folder_.path());
        EXPECT_EQ(ran.status, 1) << (ran.status == 124  ? "it hangs"
                                     : ran.status > 128 ? "it crashed"
                                                        : "")
                                 << ran.errors;
        EXPECT_EQ(std::ranges::count(ran.errors, '\n'), 1) << ran.errors;
        EXPECT_EQ(ran.output, "");
        for (const std::string& word : words) EXPECT_THAT(ran.errors, HasSubstr(word));
    }

    std::string out() const { return (folder_.path() / "out").string(); }
    void expect_nothing_left(const std::string& what) const { EXPECT_FALSE(fs::exists(out())) << what; }

    testing::TemporaryFolder folder_;
    int sessions_ = 0;
    static inline testing::TemporaryFolder* shared_ = nullptr;
};

using Words = std::vector<std::string>;

struct SpoiledSession {
    const char* what;
    std::function<void(const fs::path& folder)> spoil;
    Words words;
};

const std::vector<SpoiledSession>& spoiled_sessions() {
    static const std::vector<SpoiledSession> table{
        {"missing video",
         [](const auto& s) { fs::remove(s / "cam2.mp4"); },
         {"session.toml:", "cam2.mp4", "does not exist"}},
        {"missing background",
         [](const auto& s) { fs::remove(s / "background/cam3.mp4"); },
         {"session.toml:", "background/cam3.mp4", "does not exist"}},
        {"missing calibration",
         [](const auto& s) { fs::remove(s / "calibration.toml"); },
         {"calibration.toml", "does not exist"}},
        {"truncated video",
         [](const auto& s) { cut(s / "cam2.mp4", 0.6); },
         {"camera cam2", "cam2.mp4", "truncated", "copy it again"}},
        {"truncated background",
         [](const auto& s) { cut(s / "background/cam3.mp4", 0.6); },
         {"camera cam3", "background/cam3.mp4", "truncated"}},
        {"empty video",
         [](const auto& s) { write(s / "cam4.mp4", ""); },
         {"camera cam4", "cam4.mp4", "damaged"}},
        {"no video at all",
         [](const auto& s) { write(s / "cam4.mp4", std::string(5000, 'x')); },
         {"camera cam4", "cam4.mp4", "cannot be read as a video"}},
        {"damaged video",
         [](const auto& s) { spoil_images(s / "cam2.mp4"); },
         {"camera cam2", "cam2.mp4", "damaged"}},
        {"longer video",
         [](const auto& s) {
             fs::copy_file(s / "background/cam1.mp4", s / "cam1.mp4", fs::copy_options::overwrite_existing);
         },
         {"3 frames", "camera cam1 has 8", "the same number"}},
        {"a pipe for a video",
         [](const auto& s) {
             fs::remove(s / "cam1.mp4");
             ASSERT_EQ(mkfifo((s / "cam1.mp4").c_str(), 0600), 0);
         },
         {"camera cam1", "cam1.mp4", "neither a file nor a folder"}},
        {"a folder without images",
         [](const auto& s) {
             fs::remove(s / "cam1.mp4");
             fs::create_directory(s / "cam1.mp4");
         },
         {"camera cam1", "cam1.mp4", "contains no images"}},
        {"wrong image size",
         [](const auto& s) { edit(s / "calibration.toml", "[160.0, 120.0]", "[320.0, 240.0]"); },
         {"camera cam1", "cam1.mp4", "160 x 120", "320 x 240"}},
        {"NaN in calibration",
         [](const auto& s) { edit(s / "calibration.toml", "[[157.0,", "[[nan,"); },
         {"calibration.toml:", "cam1.matrix", "nan", "finite"}},
        {"two cameras of one name",
         [](const auto& s) { edit(s / "session.toml", "\"cam2\"", "\"cam1\""); },
         {"session.toml:", "cam1", "unique"}},
        {"two calibrations of one name",
         [](const auto& s) { edit(s / "calibration.toml", "[cam2]", "[cam1]"); },
         {"calibration.toml:", "cam1"}},
        {"a camera without calibration",
         [](const auto& s) {
             edit(s / "calibration.toml", "[cam2]", "[other]");
             edit(s / "calibration.toml", "\"cam2\"", "\"other\"");
         },
         {"camera \"cam2\"", "calibration.toml", "other"}},
        {"zero cameras",
         [](const auto& s) { write(s / "session.toml", "fps = 30.0\ncalibration = \"calibration.toml\"\n"); },
         {"session.toml", "no camera", "[[camera]]"}},
        {"one camera",
         [](const auto& s) {
             write(s / "session.toml",
                   "fps = 30.0\ncalibration = \"calibration.toml\"\n[[camera]]\nname = \"cam1\"\n"
                   "video = \"cam1.mp4\"\nbackground = \"background/cam1.mp4\"\n");
         },
         {"1 cameras", "at least 2"}},
        {"empty calibration",
         [](const auto& s) { write(s / "calibration.toml", ""); },
         {"calibration.toml", "no camera"}},
        {"rate of zero",
         [](const auto& s) { edit(s / "session.toml", "fps = 30.0", "fps = 0"); },
         {"session.toml:3", "'fps'", "0"}},
        {"unknown key",
         [](const auto& s) { edit(s / "session.toml", "fps = 30.0", "fps = 30.0\nfpps = 3"); },
         {"session.toml:4", "'fpps'", "unknown"}},
        {"bytes, not text",
         [](const auto& s) { write(s / "session.toml", std::string("\0\xff\x01[[", 5)); },
         {"session.toml:1"}},
    };
    return table;
}

TEST_F(BadInputTest, SpoiledSessionsToProcess) {
    for (const auto& row : spoiled_sessions()) {
        const fs::path session = fresh_session();
        row.spoil(session);
        expect_refused(row.what,
                       {KINEVOX_PROCESS, (session / "session.toml").string(), "--out", out(), "--quiet",
                        "--save", "silhouettes,volumes"},
                       row.words);
        expect_nothing_left(row.what);
        fs::remove_all(session);
    }
}

// What shows only when images are decoded is the capture's error, not the daemon's end; all else is refused
// at once.
TEST_F(BadInputTest, SpoiledSessionsToTheDaemon) {
    for (const auto& row : spoiled_sessions()) {
        const std::string what = row.what;
        if (what == "damaged video" || what == "truncated background") continue;  // the next test
        const fs::path session = fresh_session();
        row.spoil(session);
        const fs::path config = folder_.path() / "kinevoxd.toml";
        write(config,
              fmt::format("[server]\nlisten = \"127.0.0.1:0\"\n[pose]\ndatabase_file = \"\"\n[source]\n"
                          "kind = \"session\"\nsession_file = \"{}\"\nautostart = false\n",
                          (session / "session.toml").string()));
        expect_refused(what, {KINEVOX_DAEMON, "--config", config.string()}, row.words);
        fs::remove_all(session);
    }
}

TEST_F(BadInputTest, DaemonSurvivesBrokenVideo) {
    const fs::path session = fresh_session();
    spoil_images(session / "cam2.mp4");
    const fs::path config = folder_.path() / "kinevoxd.toml";
    write(config, fmt::format("[server]\nlisten = \"127.0.0.1:0\"\n[pose]\ndatabase_file = \"\"\n[source]\n"
                              "kind = \"session\"\nsession_file = \"{}\"\n",
                              (session / "session.toml").string()));
    testing::ChildProcess daemon({KINEVOX_DAEMON, "--config", config.string()}, folder_.path());
    const std::string line = daemon.first_line();
    ASSERT_THAT(line, ::testing::StartsWith("ready on ")) << daemon.errors();
    const std::string address = line.substr(9);
    nlohmann::json status;
    for (int i = 0; i < 200; ++i) {
        const Ran ran = testing::run({KINEVOX_CLI, "status", "--json", "--server", address}, folder_.path());
        ASSERT_EQ(ran.status, 0) << ran.errors;
        status = nlohmann::json::parse(ran.output);
        if (status["state"] == "failed") break;
        std::this_thread::sleep_for(std::chrono::milliseconds(50));
    }
    EXPECT_EQ(status["state"], "failed") << status.dump();
    EXPECT_THAT(status.dump(), HasSubstr("cam2.mp4"));
    daemon.signal(SIGTERM);
    EXPECT_EQ(daemon.wait(std::chrono::seconds(2)), 0) << daemon.errors();
}

TEST_F(BadInputTest, FlagsOfProcess) {
    const std::string good = (shared_->path() / "good/session.toml").string();
    const fs::path file = folder_.path() / "a_file";
    write(file, "kept");
    struct Row {
        std::vector<std::string> arguments;
        Words words;
    };
    std::vector<Row> table{
        {{}, {"SESSION"}},
        {{good}, {"--out"}},
        {{good, "--out", ""}, {"--out"}},
        {{"nowhere.toml", "--out", out()}, {"nowhere.toml", "no such file"}},
        {{shared_->path().string(), "--out", out()}, {shared_->path().string(), "not a file"}},
        {{good, "--out", out(), "--bogus"}, {"--bogus", "--help"}},
        {{good, "more", "--out", out()}, {"more"}},
        {{good, "--out", out(), "--device", "gpu"}, {"--device", "gpu", "cuda"}},
        {{good, "--out", out(), "--device", "cuda:x"}, {"--device", "cuda:N", "kinevox devices"}},
        {{good, "--out", out(), "--save", "everything"}, {"--save", "everything", "volumes"}},
        {{good, "--out", out(), "--frames", "-1"}, {"--frames", "-1"}},
        {{good, "--out", out(), "--threads", "-1"}, {"--threads", "-1"}},
        {{good, "--out", out(), "--background-samples", "0"}, {"samples", "0"}},
        {{good, "--out", out(), "--background-samples", "100000"}, {"samples", "100000"}},
        {{good, "--out", file.string()}, {file.string(), "Not a directory"}},
        {{good, "--out", (file / "below").string()}, {file.string(), "Not a directory"}},
        {{good, "--out", "/proc/kinevox"}, {"/proc/kinevox", "cannot be written"}},
    };
    for (const char* edge_mm : {"0", "1", "-5", "1e+09", "0.0001", "nan", "inf", "ten"})
        table.push_back({{good, "--out", out(), "--voxel-mm", edge_mm}, {"--voxel-mm", edge_mm}});
    // More voxels than memory holds is noticed at the first lattice, not by running out of it.
    const fs::path wide = folder_.path() / "wide.toml";
    write(wide, "[pipeline]\nvoxel_mm = 2\n[tracking]\nmargin_m = 1\nmax_lattice_side_m = 10\n");
    table.push_back({{good, "--out", out(), "--config", wide.string()}, {"voxel"}});
    if (fs::exists("/dev/nvidia0"))
        fmt::print("--device cuda skipped: there is a GPU\n");
    else
        table.push_back({{good, "--out", out(), "--device", "cuda"}, {"CUDA"}});
    for (const Row& row : table) {
        std::vector<std::string> command{KINEVOX_PROCESS};
        command.insert(command.end(), row.arguments.begin(), row.arguments.end());
        const std::string what = fmt::format("{}", fmt::join(command, " "));
        expect_refused(what, command, row.words);
        expect_nothing_left(what);
    }
    EXPECT_EQ(contents(file), "kept");
}

TEST_F(BadInputTest, FlagsOfStudio) {
    const fs::path file = folder_.path() / "a_file";
    write(file, "kept");
    const struct {
        std::vector<std::string> arguments;
        Words words;
    } table[] = {
        {{"--frames", "3", "--out", out()}, {"--motion"}},
        {{"--motion", "fly", "--frames", "3", "--out", out()}, {"fly", "sprint_start"}},
        {{"--motion", "walk", "--frames", "0", "--out", out()}, {"frames", "0"}},
        {{"--motion", "walk", "--frames", "x", "--out", out()}, {"--frames", "x"}},
        {{"--motion", "walk", "--frames", "3"}, {"--out"}},
        {{"--motion", "walk", "--frames", "3", "--out", out(), "--size", "big"},
         {"--size", "big", "640x480"}},
        {{"--motion", "walk", "--frames", "3", "--out", out(), "--size", "0x0"}, {"0x0"}},
        {{"--motion", "walk", "--frames", "3", "--out", out(), "--cameras", "0"}, {"cameras", "0"}},
        {{"--motion", "walk", "--frames", "3", "--out", out(), "--fps", "nan"}, {"fps", "nan"}},
        {{"--motion", "walk", "--frames", "3", "--out", out(), "--bogus"}, {"--bogus"}},
        {{"--motion", "walk", "--frames", "3", "--out", file.string()}, {file.string(), "choose another"}},
        {{"--motion", "walk", "--frames", "3", "--out", (file / "below").string()}, {file.string()}},
        {{"--motion", "walk", "--frames", "3", "--out", (shared_->path() / "good").string()},
         {"good", "not an empty folder"}},
    };
    for (const auto& row : table) {
        std::vector<std::string> command{KINEVOX_STUDIO};
        command.insert(command.end(), row.arguments.begin(), row.arguments.end());
        const std::string what = fmt::format("{}", fmt::join(command, " "));
        expect_refused(what, command, row.words);
        expect_nothing_left(what);
    }
    EXPECT_EQ(contents(file), "kept");
}

}  // namespace
}  // namespace kinevox
