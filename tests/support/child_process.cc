#include "tests/support/child_process.h"

#include <fcntl.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <atomic>
#include <fstream>
#include <sstream>
#include <thread>

#include "tests/support/patience.h"

namespace kinevox::testing {
namespace {

std::string contents(const std::filesystem::path& file) {
    std::ifstream in(file);
    std::ostringstream out;
    out << in.rdbuf();
    return out.str();
}

std::vector<char*> pointers(std::vector<std::string>& strings) {
    std::vector<char*> out;
    for (std::string& s : strings) out.push_back(s.data());
    out.push_back(nullptr);
    return out;
}

}  // namespace

ChildProcess::ChildProcess(const std::vector<std::string>& command, const std::filesystem::path& folder,
                           const std::vector<std::string>& environment) {
    static std::atomic<int> counter{0};
    const std::string name = "child" + std::to_string(counter++);
    output_ = folder / (name + ".out");
    errors_ = folder / (name + ".err");
    std::vector<std::string> arguments = command, variables = environment;
    for (char** v = environ; *v; ++v) variables.emplace_back(*v);
    const std::vector<char*> argv = pointers(arguments), envp = pointers(variables);
    id_ = fork();
    if (id_ == 0) {                        // only async-signal-safe calls from here on
        prctl(PR_SET_PDEATHSIG, SIGKILL);  // a test that is aborted leaves nothing behind
        const int out = open(output_.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0600);
        const int err = open(errors_.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0600);
        dup2(out, 1);
        dup2(err, 2);
        execve(argv[0], argv.data(), envp.data());
        _exit(127);
    }
}

ChildProcess::~ChildProcess() {
    if (wait(std::chrono::milliseconds(0))) return;
    signal(SIGKILL);
    wait(std::chrono::seconds(10));
}

void ChildProcess::signal(int number) const {
    kill(id_, number);
}

std::optional<int> ChildProcess::wait(std::chrono::milliseconds limit) {
    const auto end = std::chrono::steady_clock::now() + patient(limit);
    while (!status_) {
        int status = 0;
        if (waitpid(id_, &status, WNOHANG) == id_)
            status_ = WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
        else if (std::chrono::steady_clock::now() >= end)
            break;
        else
            std::this_thread::sleep_for(std::chrono::milliseconds(5));
    }
    return status_;
}

std::string ChildProcess::first_line() {
    for (int i = 0; i < 2000; ++i) {
        const std::string text = contents(output_);
        if (const auto end = text.find('\n'); end != std::string::npos) return text.substr(0, end);
        if (wait(std::chrono::milliseconds(5))) break;
    }
    return contents(output_);
}

std::string ChildProcess::output() const {
    return contents(output_);
}
std::string ChildProcess::errors() const {
    return contents(errors_);
}

double ChildProcess::resident_mb() const {
    std::ifstream status("/proc/" + std::to_string(id_) + "/status");
    for (std::string line; std::getline(status, line);)
        if (line.starts_with("VmRSS:")) return std::stod(line.substr(6)) / 1024;
    return 0;
}

double ChildProcess::cpu_ms() const {
    const std::string stat = contents("/proc/" + std::to_string(id_) + "/stat");
    std::istringstream after_name(stat.substr(std::min(stat.size(), stat.rfind(')') + 1)));
    std::string skipped;
    for (int i = 3; i < 14; ++i)
        after_name >> skipped;  // fields 3 to 13; 14 and 15 are user and system ticks
    double user = 0, system = 0;
    after_name >> user >> system;
    return (user + system) * 1000 / static_cast<double>(sysconf(_SC_CLK_TCK));
}

Ran run(const std::vector<std::string>& command, const std::filesystem::path& folder,
        const std::vector<std::string>& environment) {
    ChildProcess child(command, folder, environment);
    const auto status = child.wait(std::chrono::seconds(60));
    return {status.value_or(124), child.output(), child.errors()};
}

}  // namespace kinevox::testing
