// kinevox token: makes, lists and revokes the tokens that a daemon lets in.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <ctime>
#include <string>
#include <vector>

#include "common/state_folder.h"
#include "server/access/call_table.h"
#include "server/access/token_file.h"

namespace {

using namespace kinevox;

int fail(std::string message) {
    std::ranges::replace(message, '\n', ' ');
    fmt::print(stderr, "kinevox token: {}\n", message);
    return 1;
}

int fail(const absl::Status& status) {
    return fail(std::string(status.message()));
}

int create(const std::filesystem::path& file, const NewToken& wanted) {
    const auto token = create_token(file, wanted, std::time(nullptr));
    if (!token.ok()) return fail(token.status());
    // Alone on standard output, so that it can be written to a file.
    fmt::print("{}\n", *token);
    fmt::print(stderr, "This is the token of {}, role {}, {}. It is shown only now; {} holds its hash.\n",
               wanted.name, name_of(wanted.role),
               wanted.days > 0 ? fmt::format("valid for {} days", wanted.days) : "valid until it is revoked",
               file.string());
    return 0;
}

const char* state_of(const Token& token, std::int64_t now_s) {
    return token.revoked_s ? "revoked" : token.valid(now_s) ? "valid" : "expired";
}

int list(const std::filesystem::path& file) {
    const auto tokens = read_tokens(file);
    if (!tokens.ok()) return fail(tokens.status());
    fmt::print("{:<24} {:<11} {:<9} {:<21} {}\n", "name", "role", "state", "created", "expires");
    for (const Token& token : *tokens)
        fmt::print("{:<24} {:<11} {:<9} {:<21} {}\n", token.name, name_of(token.role),
                   state_of(token, std::time(nullptr)), to_utc(token.created_s),
                   token.expires_s ? to_utc(token.expires_s) : "never");
    return 0;
}

}  // namespace

int main(int argc, char** argv) {
    std::string file = in_state_folder("tokens.toml").string(), role, name;
    int days = 365;
    CLI::App app(
        "Tokens for programs that call a daemon from other machines. The daemon reads their hashes from the "
        "file that "
        "[server] tokens names; what changes there acts within two seconds.",
        "kinevox token");
    app.require_subcommand(1);
    const auto add = [&](const char* verb, const char* what) {
        CLI::App* sub = app.add_subcommand(verb, what);
        sub->add_option("--file", file, "The tokens' file")->capture_default_str();
        return sub;
    };
    CLI::App* const creates = add("create", "Makes a token and shows it, once");
    creates->add_option("--role", role, "What it is for")
        ->required()
        ->check(CLI::IsMember(std::vector<std::string>{"watch", "exhibit", "operate", "administer"}));
    creates->add_option("--name", name, "Of who will hold it; the audit log shows it")->required();
    creates->add_option("--days", days, "How long it is valid; 0: until it is revoked")
        ->capture_default_str()
        ->check(CLI::Range(0, 36500));
    CLI::App* const lists = add("list", "Whose tokens there are");
    CLI::App* const revokes = add("revoke", "Makes a token worthless; streams that it opened end");
    revokes->add_option("name", name, "Of its holder")->required();
    try {
        app.parse(argc, argv);
    } catch (const CLI::ParseError& error) {
        if (error.get_exit_code() == 0) return app.exit(error);
        return fail(std::string(error.what()) + "; see kinevox token --help");
    }
    if (file.empty()) return fail("there is no home to keep the tokens in; give --file");
    if (creates->parsed()) return create(file, {name, role_named(role), days});
    if (lists->parsed()) return list(file);
    const absl::Status revoked = revoke_token(file, name, std::time(nullptr));
    return revoked.ok() ? 0 : fail(revoked);
}
