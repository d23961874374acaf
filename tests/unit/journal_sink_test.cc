// What the journal receives for a line of the log, with a socket instead of it.
#include "server/daemon/journal_sink.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <spdlog/logger.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include <cstdlib>
#include <cstring>
#include <memory>
#include <string>

#include "common/log_fields.h"
#include "tests/support/temporary_folder.h"

namespace kinevox {
namespace {

class FakeJournal {
  public:
    explicit FakeJournal(const std::filesystem::path& path)
        : socket_(::socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0)) {
        sockaddr_un address{};
        address.sun_family = AF_UNIX;
        std::strncpy(address.sun_path, path.c_str(), sizeof address.sun_path - 1);
        EXPECT_EQ(::bind(socket_, reinterpret_cast<const sockaddr*>(&address), sizeof address), 0);
    }
    ~FakeJournal() { ::close(socket_); }

    // Empty where nothing was sent.
    std::string take() const {
        std::string datagram(4096, '\0');
        const ssize_t size = ::recv(socket_, datagram.data(), datagram.size(), MSG_DONTWAIT);
        datagram.resize(size > 0 ? static_cast<std::size_t>(size) : 0);
        return datagram;
    }

  private:
    int socket_;
};

class JournalSinkTest : public ::testing::Test {
  protected:
    testing::TemporaryFolder folder_;
    const std::filesystem::path path_ = folder_.path() / "socket";
    spdlog::logger log_{"kinevoxd", std::make_shared<JournalSink>(path_)};
};

TEST_F(JournalSinkTest, SendsPriorityMessageAndFields) {
    const FakeJournal journal(path_);
    const LogFields run{{"KINEVOX_EVENT", "outer"}};
    {
        const LogFields fields{
            {"KINEVOX_EVENT", "camera_disconnected"}, {"KINEVOX_CAMERA", "cam1"}, {"KINEVOX_RECORDING", ""}};
        log_.error("cam1 is gone");
    }
    log_.info("all is well");
    EXPECT_EQ(journal.take(),
              "MESSAGE=cam1 is gone\nPRIORITY=3\nSYSLOG_IDENTIFIER=kinevoxd\nKINEVOX_EVENT=outer\n"
              "KINEVOX_EVENT=camera_disconnected\nKINEVOX_CAMERA=cam1\n");
    EXPECT_EQ(journal.take(),
              "MESSAGE=all is well\nPRIORITY=6\nSYSLOG_IDENTIFIER=kinevoxd\nKINEVOX_EVENT=outer\n");
    EXPECT_EQ(journal.take(), "");
}

TEST_F(JournalSinkTest, UsesSyslogPriorities) {
    const FakeJournal journal(path_);
    log_.warn("w");
    log_.critical("c");
    EXPECT_THAT(journal.take(), ::testing::HasSubstr("PRIORITY=4\n"));
    EXPECT_THAT(journal.take(), ::testing::HasSubstr("PRIORITY=2\n"));
}

TEST_F(JournalSinkTest, EscapesMultilineValues) {
    const FakeJournal journal(path_);
    log_.info("refused\nPRIORITY=0");
    using namespace std::string_literals;
    EXPECT_THAT(journal.take(),
                ::testing::StartsWith("MESSAGE\n\x12\0\0\0\0\0\0\0refused\nPRIORITY=0\nPRIORITY=6\n"s));
}

TEST_F(JournalSinkTest, FallsBackToStandardError) {
    ::testing::internal::CaptureStderr();
    log_.warn("no journal");
    EXPECT_EQ(::testing::internal::GetCapturedStderr(), "<4>no journal\n");
    const FakeJournal journal(path_);  // restarted
    log_.warn("again");
    EXPECT_THAT(journal.take(), ::testing::StartsWith("MESSAGE=again\n"));
}

TEST(StderrIsJournal, IfStreamMatches) {
    struct stat now {};
    ASSERT_EQ(::fstat(STDERR_FILENO, &now), 0);
    ::setenv("JOURNAL_STREAM", fmt::format("{}:{}", now.st_dev, now.st_ino).c_str(), 1);
    EXPECT_TRUE(stderr_is_journal());
    ::setenv("JOURNAL_STREAM", fmt::format("{}:{}", now.st_dev, now.st_ino + 1).c_str(), 1);
    EXPECT_FALSE(stderr_is_journal()) << "standard error was sent elsewhere since";
    ::unsetenv("JOURNAL_STREAM");
    EXPECT_FALSE(stderr_is_journal());
}

}  // namespace
}  // namespace kinevox
