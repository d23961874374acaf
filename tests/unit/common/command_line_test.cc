// What command lines parse by hand: frame ranges, addresses, and suggestions for mistyped words.
#include "common/command_line.h"

#include <gtest/gtest.h>

#include "common/export_options.h"
#include "common/host_port.h"
#include "common/progress_line.h"

namespace kinevox {
namespace {

TEST(FrameRange, ReadsFirstAndLastInclusive) {
    const auto range = parse_frame_range("30-89");
    ASSERT_TRUE(range);
    EXPECT_EQ(range->first, 30);
    EXPECT_EQ(range->last, 89);
    EXPECT_EQ(parse_frame_range("7-7")->last, 7) << "a single frame";
    EXPECT_FALSE(parse_frame_range("12-")->last) << "to the end";
}

TEST(FrameRange, RefusesOtherText) {
    for (const char* text :
         {"", "-", "30", "89-30", "-5", "a-b", "3-4x", "3--4", " 3-4", "3-99999999999999999999"})
        EXPECT_FALSE(parse_frame_range(text)) << text;
}

TEST(HostPort, ReadsNamesAddressesAndIpv6) {
    EXPECT_EQ(parse_host_port("studio-pc:50770")->host, "studio-pc");
    EXPECT_EQ(parse_host_port("127.0.0.1:0")->port, 0);
    const auto v6 = parse_host_port("[::1]:8090");
    ASSERT_TRUE(v6);
    EXPECT_EQ(v6->host, "::1");
    EXPECT_EQ(v6->to_string(), "[::1]:8090");
}

TEST(HostPort, RefusesOtherText) {
    for (const char* text : {"", ":80", "host", "host:", "host:65536", "host:x", "::1:80", "[]:80", "a b:80",
                             "http://host:80", "host:-1"})
        EXPECT_FALSE(parse_host_port(text)) << text;
}

TEST(HostPort, HostOfAddressWithAndWithoutPort) {
    for (const auto& [text, host] : {std::pair{"localhost:80", "localhost"},
                                     {"localhost", "localhost"},
                                     {"[::1]:80", "::1"},
                                     {"[::1]", "::1"},
                                     {"::1", "::1"},
                                     {"[", "["}})
        EXPECT_EQ(host_of(text), host) << text;
}

TEST(ClosestWord, SuggestsSmallEditsOnly) {
    const std::vector<std::string> words{"status", "start", "stop", "stream", "--max-rate"};
    EXPECT_EQ(closest_word("statsu", words), "status");
    EXPECT_EQ(closest_word("strem", words), "stream");
    EXPECT_EQ(closest_word("--max-rte", words), "--max-rate");
    EXPECT_FALSE(closest_word("juggle", words));
    EXPECT_FALSE(closest_word("x", words));
}

TEST(ParseErrorText, NamesUnknownCommandOrOption) {
    CLI::App app("", "tool");
    app.add_option("--server");
    app.add_subcommand("record")->add_subcommand("delete")->add_flag("--yes");
    const CLI::ParseError error("other", 1);
    EXPECT_EQ(parse_error_text(app, {"recrod"}, error),
              "unknown command 'recrod'; did you mean 'record'? see tool --help");
    EXPECT_EQ(parse_error_text(app, {"--server", "x", "record", "delte"}, error),
              "unknown record command 'delte'; did you mean 'delete'? see tool --help");
    EXPECT_EQ(parse_error_text(app, {"record", "delete", "--yse"}, error),
              "unknown option '--yse'; did you mean '--yes'? see tool --help");
    EXPECT_EQ(parse_error_text(app, {"record", "delete"}, error), "other; see tool --help");
}

TEST(ProgressLine, WritesNothingWithoutTerminal) {
    ::testing::internal::CaptureStderr();  // into a file
    {
        ProgressLine line;
        line.draw("starting the capture ...");
        line.show(0.5);
    }
    EXPECT_EQ(::testing::internal::GetCapturedStderr(), "");
}

}  // namespace
}  // namespace kinevox
