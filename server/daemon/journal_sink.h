// Sends the log to systemd's journal, with level, message and fields.
#pragma once

#include <spdlog/sinks/base_sink.h>

#include <filesystem>
#include <mutex>
#include <string>
#include <string_view>

namespace kinevox {

inline constexpr const char* kJournalSocket = "/run/systemd/journal/socket";

// Whether standard error is connected to the journal, by the service manager's JOURNAL_STREAM (man
// systemd.exec).
bool stderr_is_journal();

// One datagram per line, by the journal's native protocol. A line that the journal does not accept at once
// goes to standard error, so that logging never blocks; sd_journal_sendv() would wait.
class JournalSink final : public spdlog::sinks::base_sink<std::mutex> {
  public:
    explicit JournalSink(std::filesystem::path socket = kJournalSocket);
    ~JournalSink() override;

  protected:
    void sink_it_(const spdlog::details::log_msg& line) override;
    void flush_() override {}

  private:
    bool send(const std::string& datagram);

    const std::filesystem::path path_;
    int socket_ = -1;
};

// One field of the native protocol; a value of several lines is preceded by its length.
std::string journal_field(std::string_view name, std::string_view value);

}  // namespace kinevox
