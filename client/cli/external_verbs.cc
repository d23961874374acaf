#include <unistd.h>

#include <cerrno>
#include <cstdlib>
#include <set>
#include <sstream>
#include <system_error>

#include "client/cli/verbs.h"

namespace kinevox::cli {
namespace {

namespace fs = std::filesystem;
constexpr const char* kPrefix = "kinevox-";

std::vector<fs::path> folders() {
    std::vector<fs::path> out;
    std::error_code error;
    const fs::path self = fs::read_symlink("/proc/self/exe", error);
    if (!error) {
        const fs::path here = self.parent_path();
        out = {here, here / "../lib/kinevox", here / "../../server/tools"};
    }
    if (const char* path = std::getenv("PATH")) {
        std::istringstream parts(path);
        for (std::string part; std::getline(parts, part, ':');)
            if (!part.empty()) out.emplace_back(part);
    }
    return out;
}

bool is_program(const fs::path& file) {
    std::error_code error;
    return fs::is_regular_file(file, error) && access(file.c_str(), X_OK) == 0;
}

}  // namespace

std::optional<fs::path> find_external_verb(const std::string& verb) {
    if (verb.empty() || verb.find('/') != std::string::npos) return std::nullopt;
    for (const fs::path& folder : folders())
        if (fs::path file = folder / (kPrefix + verb); is_program(file)) return file.lexically_normal();
    return std::nullopt;
}

std::vector<std::string> external_verbs() {
    std::set<std::string> found;
    for (const fs::path& folder : folders()) {
        std::error_code error;
        for (const fs::directory_entry& entry : fs::directory_iterator(folder, error)) {
            const std::string name = entry.path().filename().string();
            if (name.starts_with(kPrefix) && is_program(entry.path()))
                found.insert(name.substr(std::char_traits<char>::length(kPrefix)));
        }
    }
    return {found.begin(), found.end()};
}

std::string run_external_verb(const fs::path& program, std::vector<std::string> arguments) {
    std::vector<char*> argv;
    for (std::string& argument : arguments) argv.push_back(argument.data());
    argv.push_back(nullptr);
    execv(program.c_str(), argv.data());
    return "cannot start " + program.string() + ": " + std::generic_category().message(errno);
}

}  // namespace kinevox::cli
