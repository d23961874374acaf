// kinevoxd as a service: this test is the service manager, with a socket and a watchdog of its own.
#include <gmock/gmock.h>
#include <poll.h>
#include <sys/ptrace.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>

#include "tests/integration/daemon/daemon_fixture.h"

namespace kinevox {
namespace {

using namespace std::chrono_literals;
using Clock = std::chrono::steady_clock;
using testing::ChildProcess;
using ::testing::HasSubstr;

class ServiceManagerTest : public testing::DaemonTest {
  protected:
    void SetUp() override {
        socket_ = socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0);
        sockaddr_un address{.sun_family = AF_UNIX};
        std::snprintf(address.sun_path, sizeof address.sun_path, "%s", (folder_.path() / "notify").c_str());
        const int yes = 1;
        ASSERT_EQ(setsockopt(socket_, SOL_SOCKET, SO_PASSCRED, &yes, sizeof yes), 0);
        ASSERT_EQ(bind(socket_, reinterpret_cast<const sockaddr*>(&address), sizeof address), 0);
    }
    ~ServiceManagerTest() override { close(socket_); }

    std::unique_ptr<ChildProcess> start_service(const std::string& config, Clock::duration watchdog) {
        const auto file = write("kinevoxd.toml", config);
        auto daemon = std::make_unique<ChildProcess>(
            std::vector<std::string>{KINEVOX_DAEMON, "--config", file.string()}, folder_.path(),
            std::vector<std::string>{"NOTIFY_SOCKET=" + (folder_.path() / "notify").string(),
                                     fmt::format("WATCHDOG_USEC={}", watchdog / 1us)});
        return daemon;
    }

    // The next datagram; empty where none came in time.
    std::string heard(Clock::duration limit) {
        pollfd waiting{socket_, POLLIN, 0};
        if (poll(&waiting, 1, static_cast<int>(limit / 1ms)) <= 0) return "";
        char bytes[4096], control[CMSG_SPACE(sizeof(ucred))];
        iovec piece{bytes, sizeof bytes};
        msghdr message{
            .msg_iov = &piece, .msg_iovlen = 1, .msg_control = control, .msg_controllen = sizeof control};
        const ssize_t count = recvmsg(socket_, &message, 0);
        if (const cmsghdr* header = CMSG_FIRSTHDR(&message); header && header->cmsg_type == SCM_CREDENTIALS)
            std::memcpy(&sender_, CMSG_DATA(header), sizeof sender_);
        return {bytes, static_cast<std::size_t>(std::max<ssize_t>(count, 0))};
    }

    // Listens until one with these words comes; it, or empty after the limit. Counts signs of life meanwhile.
    std::string wait_for(const std::string& words, Clock::duration limit) {
        alive_ = 0;
        for (const auto end = Clock::now() + limit; Clock::now() < end;) {
            const std::string said = heard(end - Clock::now());
            alive_ += said.find("WATCHDOG=1") != std::string::npos;
            if (said.find(words) != std::string::npos) return said;
        }
        return "";
    }

    // Only WATCHDOG=1, at least N times.
    void expect_alive(Clock::duration how_long, int least) {
        EXPECT_EQ(wait_for("WATCHDOG=trigger", how_long), "");
        EXPECT_GE(alive_, least);
    }

    int socket_ = -1;
    ucred sender_{};
    int alive_ = 0;
};

// One thread of a program, held where it is.
class HeldThread {
  public:
    static pid_t find(pid_t process, const std::string& name) {
        for (const auto& task : std::filesystem::directory_iterator(fmt::format("/proc/{}/task", process))) {
            std::string found;
            std::getline(std::ifstream(task.path() / "comm") >> std::ws, found);
            if (found == name) return std::stoi(task.path().filename());
        }
        return 0;
    }
    explicit HeldThread(pid_t id) : id_(id) {
        held_ = ptrace(PTRACE_SEIZE, id_, nullptr, nullptr) == 0 &&
                ptrace(PTRACE_INTERRUPT, id_, nullptr, nullptr) == 0 && waitpid(id_, nullptr, __WALL) == id_;
    }
    ~HeldThread() {
        if (held_) ptrace(PTRACE_DETACH, id_, nullptr, nullptr);
    }
    bool held() const { return held_; }

  private:
    const pid_t id_;
    bool held_ = false;
};

const std::string kRestful =
    "[pose]\ndatabase_file = \"\"\nauto_fit_body = false\nfitted_body_file = \"\"\n[recording]\nfolder = "
    "\"\"\n"
    "[calibration]\nfolder = \"\"\n[server]\nlisten = \"127.0.0.1:0\"\n";
const std::string kStudio =
    "[source]\nkind = \"studio\"\n[source.studio]\nwidth_px = 160\nheight_px = 120\nfps = 20\ncamera_count = "
    "2\n";

TEST_F(ServiceManagerTest, ReceivesReadyStatusAndStop) {
    const auto daemon = start_service(kRestful + kStudio, 2s);
    EXPECT_NE(wait_for("READY=1", 20s), "") << daemon->errors();
    EXPECT_EQ(sender_.pid, daemon->id()) << "although it restarts itself for huge pages";
    EXPECT_TRUE(daemon->first_line().starts_with("ready on "));
    EXPECT_THAT(wait_for("STATUS=capturing, ", 20s), HasSubstr("frame sets per second"));
    daemon->signal(SIGTERM);
    EXPECT_NE(wait_for("STOPPING=1", 5s), "");
    EXPECT_EQ(daemon->wait(5s), 0);
}

TEST_F(ServiceManagerTest, KeepsIdleDaemonAlive) {
    const auto daemon = start_service(kRestful + "[source]\nkind = \"studio\"\nautostart = false\n", 800ms);
    ASSERT_NE(wait_for("READY=1", 20s), "") << daemon->errors();
    expect_alive(2s, 4);
}

TEST_F(ServiceManagerTest, KeepsDaemonAliveAfterSessionEnd) {
    const auto daemon = start_service(
        kRestful + fmt::format("[source]\nkind = \"session\"\nsession_file = \"{}\"\nloop = false\n",
                               session_.string()),
        800ms);
    ASSERT_NE(wait_for("STATUS=source ended", 30s), "") << daemon->errors();
    expect_alive(2s, 4);
}

TEST_F(ServiceManagerTest, ReportsHungPipeline) {
    const auto daemon = start_service(kRestful + kStudio, 2s);
    ASSERT_NE(wait_for("STATUS=capturing, ", 20s), "") << daemon->errors();
    for (const char* name : {"posing", "reconstructing"}) {
        // Until it is held with a frame set in hand, not while it waits for one.
        std::string trigger;
        for (int attempt = 0; attempt < 10 && trigger.empty(); ++attempt) {
            const pid_t thread = HeldThread::find(daemon->id(), name);
            ASSERT_NE(thread, 0) << name;
            const HeldThread held(thread);
            if (!held.held()) GTEST_SKIP() << "no thread may be held here: " << std::strerror(errno);
            trigger = wait_for("WATCHDOG=trigger", 2s);
            if (trigger.empty()) continue;
            while (!heard(0s).empty()) {
            }
            wait_for("WATCHDOG=trigger", 2s);
            EXPECT_EQ(alive_, 0) << name << ": signals although it hangs";
            EXPECT_THAT(daemon->errors(), HasSubstr("the pipeline hangs"));
        }
        EXPECT_NE(trigger, "") << name;
        EXPECT_NE(wait_for("WATCHDOG=1", 5s), "") << name << ": alive again when it continues";
    }
}

}  // namespace
}  // namespace kinevox
