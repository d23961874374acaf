// The connection options: the command line takes precedence over the environment, that over the default.
#include <gtest/gtest.h>

#include <CLI/CLI.hpp>
#include <cstdlib>
#include <string>
#include <vector>

#include "client/lib/client_program.h"

namespace kinevox::client {
namespace {

// An app with a group of two subcommands, as `kinevox record start` and `record stop`.
struct Program {
    ConnectionOptions options;
    CLI::App app;

    explicit Program(const std::string& line) {
        add_connection_options(app, options);
        CLI::App* const record = app.add_subcommand("record");
        record->add_subcommand("start");
        record->add_subcommand("stop");
        app.parse(line);
    }
};

struct Row {
    const char *option, *variable;
    std::string SecurityFiles::*member;
};
const Row kFiles[] = {{"--ca", "KINEVOX_CA", &SecurityFiles::ca},
                      {"--certificate", "KINEVOX_CERTIFICATE", &SecurityFiles::certificate},
                      {"--key", "KINEVOX_KEY", &SecurityFiles::key},
                      {"--server-name", "KINEVOX_SERVER_NAME", &SecurityFiles::server_name},
                      {"--token-file", "KINEVOX_TOKEN_FILE", &SecurityFiles::token}};

class OptionPrecedence : public ::testing::Test {
  protected:
    void TearDown() override {
        for (const char* variable : {"KINEVOX_SERVER", "KINEVOX_TLS"}) unsetenv(variable);
        for (const Row& row : kFiles) unsetenv(row.variable);
    }
};

TEST_F(OptionPrecedence, ServerBeforeOrAfterCommandOverridesEnvironment) {
    EXPECT_EQ(Program("record start").options.server, kDefaultServer);
    setenv("KINEVOX_SERVER", "env:1", 1);
    EXPECT_EQ(Program("record start").options.server, "env:1");
    for (const char* line : {"--server flag:2 record start", "record --server flag:2 start",
                             "record start --server flag:2", "record stop --server=flag:2"})
        EXPECT_EQ(Program(line).options.server, "flag:2") << line;
}

TEST_F(OptionPrecedence, EachFileOverridesEnvironment) {
    for (const Row& row : kFiles) {
        EXPECT_EQ(Program("record start").options.files.*row.member, "") << row.option;
        setenv(row.variable, "env", 1);
        EXPECT_EQ(Program("record start").options.files.*row.member, "env") << row.option;
        for (const std::string& line : {std::string(row.option) + " flag record start",
                                        std::string("record start ") + row.option + " flag"})
            EXPECT_EQ(Program(line).options.files.*row.member, "flag") << line;
        unsetenv(row.variable);
    }
}

TEST_F(OptionPrecedence, TlsFlagOverridesEnvironment) {
    EXPECT_FALSE(Program("record start").options.files.tls);
    setenv("KINEVOX_TLS", "1", 1);
    EXPECT_TRUE(Program("record start").options.files.tls);
    EXPECT_FALSE(Program("record start --tls=false").options.files.tls);
    setenv("KINEVOX_TLS", "0", 1);
    EXPECT_TRUE(Program("--tls record start").options.files.tls);
}

}  // namespace
}  // namespace kinevox::client
