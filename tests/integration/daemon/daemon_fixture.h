// A real kinevoxd on a free port.
#pragma once

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <fstream>
#include <memory>
#include <string>

#include "client/lib/client.h"
#include "tests/support/child_process.h"
#include "tests/support/small_session.h"

namespace kinevox::testing {

class DaemonTest : public ::testing::Test {
  protected:
    static void SetUpTestSuite() {
        shared_ = new TemporaryFolder;
        session_ = write_small_session(shared_->path());
    }
    static void TearDownTestSuite() {
        delete shared_;
        shared_ = nullptr;
    }

    std::filesystem::path write(const std::string& name, const std::string& text) const {
        const std::filesystem::path file = folder_.path() / name;
        std::ofstream(file) << text;
        return file;
    }

    static std::string session_config(const std::string& listen, const std::string& more = "",
                                      const std::string& pose = "database_file = \"\"") {
        return fmt::format(
            "[server]\nlisten = \"{}\"\n[pose]\n{}\n[source]\nkind = \"session\"\nsession_file = \"{}\"\n{}",
            listen, pose, session_.string(), more);
    }

    // Waits until it is ready; `address` then holds where.
    std::unique_ptr<ChildProcess> start_daemon(const std::string& config) {
        const auto file = write("kinevoxd.toml", config);
        auto daemon = std::make_unique<ChildProcess>(
            std::vector<std::string>{KINEVOX_DAEMON, "--config", file.string()}, folder_.path());
        const std::string line = daemon->first_line();
        EXPECT_TRUE(line.starts_with("ready on 127.0.0.1:")) << line << daemon->errors();
        address_ = line.substr(std::min(line.size(), std::string("ready on ").size()));
        return daemon;
    }

    Ran kinevox(std::vector<std::string> arguments, const std::vector<std::string>& environment = {}) {
        arguments.insert(arguments.begin(), KINEVOX_CLI);
        std::vector<std::string> variables = environment;
        variables.push_back("KINEVOX_SERVER=" + address_);
        return run(arguments, folder_.path(), variables);
    }

    // Reads results until a subject is tracked.
    void wait_for_a_volume(client::Client& client) {
        client::StreamOptions options;
        options.idle_timeout = std::chrono::seconds(20);
        const absl::Status status = client.stream_volumes(
            {}, [](const auto& frame) { return !frame.first_subject() || !frame.first_subject()->volume; },
            options);
        ASSERT_TRUE(status.ok()) << status;
    }

    TemporaryFolder folder_;
    std::string address_;
    static inline TemporaryFolder* shared_ = nullptr;
    static inline std::filesystem::path session_;
};

}  // namespace kinevox::testing
