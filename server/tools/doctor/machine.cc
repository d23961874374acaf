#include <algorithm>
#include <charconv>
#include <fstream>
#include <sstream>
#include <system_error>

#include "server/tools/doctor/checks.h"

namespace kinevox::doctor {

std::string Machine::text(const std::string& path) const {
    std::ifstream in(at(path));
    std::ostringstream out;
    out << in.rdbuf();
    std::string text = out.str();
    text.erase(
        std::find_if(text.rbegin(), text.rend(), [](unsigned char c) { return !std::isspace(c); }).base(),
        text.end());
    return text;
}

std::optional<long long> Machine::number(const std::string& path) const {
    const std::string words = text(path);
    long long value = 0;
    const auto [end, error] = std::from_chars(words.data(), words.data() + words.size(), value);
    return error == std::errc{} ? std::optional(value) : std::nullopt;
}

bool Machine::exists(const std::string& path) const {
    std::error_code error;
    return std::filesystem::exists(at(path), error);
}

std::vector<std::string> Machine::names(const std::string& folder) const {
    std::error_code error;
    std::vector<std::string> out;
    for (const auto& entry : std::filesystem::directory_iterator(at(folder), error))
        out.push_back(entry.path().filename());
    std::ranges::sort(out);
    return out;
}

// By its command line: the daemon restarts itself through a link for huge pages, which changes the kernel's
// name.
int Machine::process(const std::string& name) const {
    for (const std::string& entry : names("proc")) {
        if (!std::ranges::all_of(entry, [](unsigned char c) { return std::isdigit(c); })) continue;
        const std::string command = text("proc/" + entry + "/cmdline");
        if (std::filesystem::path(command.substr(0, command.find('\0'))).filename() == name)
            return std::stoi(entry);
    }
    return 0;
}

}  // namespace kinevox::doctor
