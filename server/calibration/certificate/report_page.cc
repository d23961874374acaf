#include "server/calibration/certificate/report_page.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <string>

extern char** environ;

namespace kinevox {
namespace {

namespace fs = std::filesystem;

fs::path report_program() {
    std::error_code error;
    const fs::path here = fs::read_symlink("/proc/self/exe", error).parent_path();
    if (error) return {};
    // Installed, in the build folder, in its tests.
    for (const char* folder : {".", "../lib/kinevox", "../tools", "../../server/tools"})
        if (const fs::path file = here / folder / "kinevox-report"; access(file.c_str(), X_OK) == 0)
            return file.lexically_normal();
    return {};
}

}  // namespace

absl::Status draw_report_page(const fs::path& json_file, const fs::path& png_file) {
    const std::string program = report_program().string();
    if (program.empty())
        return absl::NotFoundError(
            "the page was not drawn: kinevox-report is not installed next to this program");
    const std::string json = json_file.string(), png = png_file.string();
    std::string words[] = {program, json, "--out", png, "--overwrite"};
    char* arguments[] = {words[0].data(), words[1].data(), words[2].data(),
                         words[3].data(), words[4].data(), nullptr};
    posix_spawn_file_actions_t actions;
    posix_spawn_file_actions_init(&actions);
    posix_spawn_file_actions_addopen(&actions, STDOUT_FILENO, "/dev/null", O_WRONLY, 0);
    posix_spawn_file_actions_addopen(&actions, STDERR_FILENO, "/dev/null", O_WRONLY, 0);
    pid_t child = 0;
    const int started = posix_spawn(&child, program.c_str(), &actions, nullptr, arguments, environ);
    posix_spawn_file_actions_destroy(&actions);
    int status = -1;
    if (started == 0)
        while (waitpid(child, &status, 0) < 0 && errno == EINTR) continue;
    if (started != 0 || !WIFEXITED(status) || WEXITSTATUS(status) != 0)
        return absl::UnavailableError(
            fmt::format("the page was not drawn; kinevox report {} reports the reason", json));
    return absl::OkStatus();
}

}  // namespace kinevox
