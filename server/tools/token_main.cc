// kinevox token: creates, lists and revokes the access tokens of a daemon.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <cstdio>
#include <ctime>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "common/command_line.h"
#include "common/files.h"
#include "server/access/call_table.h"
#include "server/access/token_file.h"

namespace {

using namespace kinevox;

struct Arguments {
    std::string file = in_state_folder("tokens.toml").string(), role, name;
    int days = 365;
    bool json = false;
};

absl::Status create(const Arguments& arguments) {
    const NewToken wanted{arguments.name, role_named(arguments.role), arguments.days};
    const auto token = create_token(arguments.file, wanted, std::time(nullptr));
    if (!token.ok()) return token.status();
    if (arguments.json) {
        fmt::print("{}\n", nlohmann::ordered_json({{"name", wanted.name},
                                                   {"role", name_of(wanted.role)},
                                                   {"days", wanted.days},
                                                   {"token", *token},
                                                   {"file", arguments.file}})
                               .dump());
        return absl::OkStatus();
    }
    // Alone on standard output, so that it can be redirected to a file.
    fmt::print("{}\n", *token);
    fmt::print(stderr, "Token of {}, role {}, {}. It is shown only once; {} stores its hash.\n", wanted.name,
               name_of(wanted.role),
               wanted.days > 0 ? fmt::format("valid for {} days", wanted.days) : "valid until revoked",
               arguments.file);
    return absl::OkStatus();
}

const char* state_of(const Token& token, std::int64_t now_s) {
    return token.revoked_s ? "revoked" : token.valid(now_s) ? "valid" : "expired";
}

absl::Status list(const Arguments& arguments) {
    const auto tokens = read_tokens(arguments.file);
    if (!tokens.ok()) return tokens.status();
    const std::int64_t now_s = std::time(nullptr);
    if (arguments.json) {
        auto out = nlohmann::ordered_json::array();
        for (const Token& token : *tokens)
            out.push_back({{"name", token.name},
                           {"role", name_of(token.role)},
                           {"state", state_of(token, now_s)},
                           {"create_time", to_utc(token.created_s)},
                           {"expire_time", token.expires_s ? nlohmann::ordered_json(to_utc(token.expires_s))
                                                           : nlohmann::ordered_json(nullptr)}});
        fmt::print("{}\n", out.dump());
        return absl::OkStatus();
    }
    fmt::print("{:<24} {:<9} {:<9} {:<21} {}\n", "name", "role", "state", "created", "expires");
    for (const Token& token : *tokens)
        fmt::print("{:<24} {:<9} {:<9} {:<21} {}\n", token.name, name_of(token.role), state_of(token, now_s),
                   to_utc(token.created_s), token.expires_s ? to_utc(token.expires_s) : "never");
    return absl::OkStatus();
}

absl::Status revoke(const Arguments& arguments) {
    absl::Status revoked = revoke_token(arguments.file, arguments.name, std::time(nullptr));
    if (revoked.ok() && arguments.json)
        fmt::print("{}\n", nlohmann::ordered_json({{"name", arguments.name}, {"state", "revoked"}}).dump());
    return revoked;
}

}  // namespace

int main(int argc, char** argv) {
    Arguments arguments;
    CLI::App app(
        "Manage access tokens of clients. The daemon reads their hashes from the file [server] token_file; "
        "changes take effect within two seconds.",
        "kinevox token");
    app.require_subcommand(1);
    absl::Status (*act)(const Arguments&) = nullptr;
    const auto add = [&](const char* name, const char* help, absl::Status (*run)(const Arguments&)) {
        CLI::App* command = app.add_subcommand(name, help);
        command->add_option("--file", arguments.file, "Token file")->capture_default_str();
        command->add_flag("--json", arguments.json, "Print JSON");
        command->callback([&act, run] { act = run; });
        return command;
    };
    CLI::App* const creating = add("create", "Create a token and print it once", create);
    creating->add_option("NAME", arguments.name, "Name of the token's user, shown in the audit log")
        ->required();
    creating->add_option("--role", arguments.role, "Role of the token")
        ->required()
        ->check(CLI::IsMember(std::vector<std::string>{"viewer", "display", "operator", "admin"}));
    creating->add_option("--days", arguments.days, "Validity (days; 0: until revoked)")
        ->capture_default_str()
        ->check(CLI::Range(0, 36500));
    add("list", "List tokens", list);
    add("revoke", "Revoke a token and end its streams", revoke)
        ->add_option("NAME", arguments.name, "Name shown by `kinevox token list`")
        ->required();
    return tool_main(app, argc, argv, [&]() -> absl::Status {
        if (arguments.file.empty())
            return absl::FailedPreconditionError("no home folder for the token file; give --file");
        return act(arguments);
    });
}
