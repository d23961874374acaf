// kinevox tls: a private certificate authority, and certificates of it for the daemon and its clients.
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <ctime>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "common/command_line.h"
#include "common/files.h"
#include "server/access/certificates.h"
#include "server/access/private_file.h"

namespace {

using namespace kinevox;
namespace fs = std::filesystem;
using Kind = NewCertificate::Kind;

constexpr std::int64_t kDay = 86'400;
constexpr int kAuthorityDays = 3650;

struct Arguments {
    std::string out = in_state_folder("tls").string(), name;
    std::vector<std::string> hosts;
    int days = 825;
    bool json = false;
};

// Names and addresses of this machine.
std::vector<std::string> own_names() {
    std::vector<std::string> names{"localhost", "127.0.0.1", "::1"};
    char host[256] = "";
    if (gethostname(host, sizeof host - 1) == 0 && *host && std::ranges::find(names, host) == names.end())
        names.insert(names.begin(), host);
    return names;
}

// NAME.pem and NAME-key.pem; neither if one of them exists.
absl::Status write_pair(const fs::path& folder, const std::string& name, const CertificateAndKey& made) {
    const fs::path certificate = folder / (name + ".pem"), key = folder / (name + "-key.pem");
    for (const fs::path& file : {certificate, key})
        if (std::error_code ignored; fs::exists(file, ignored))
            return absl::AlreadyExistsError(
                fmt::format("{} exists and is not replaced; move it, or give another --out", file.string()));
    if (absl::Status written = write_private_file(key, made.key, Existing::kKeep); !written.ok())
        return written;
    if (absl::Status written = write_private_file(certificate, made.certificate, Existing::kKeep);
        !written.ok())
        return written;
    std::error_code ignored;  // certificates are public
    fs::permissions(certificate, fs::perms::group_read | fs::perms::others_read, fs::perm_options::add,
                    ignored);
    return absl::OkStatus();
}

absl::StatusOr<CertificateAndKey> read_authority(const fs::path& folder) {
    auto certificate = read_file(folder / "ca.pem"), key = read_file(folder / "ca-key.pem");
    if (!certificate.ok() || !key.ok())
        return absl::NotFoundError(fmt::format(
            "{} has no ca.pem and ca-key.pem; run kinevox tls init, or give --out", folder.string()));
    return CertificateAndKey{*std::move(certificate), *std::move(key)};
}

absl::Status issue(const fs::path& folder, const std::string& file, NewCertificate wanted, int days) {
    auto authority = read_authority(folder);
    if (!authority.ok()) return authority.status();
    wanted.from_s = std::time(nullptr) - 300;  // for clocks that are slightly behind
    wanted.until_s = std::time(nullptr) + days * kDay;
    const auto made = make_certificate(wanted, &*authority);
    if (!made.ok()) return made.status();
    return write_pair(folder, file, *made);
}

absl::Status create_authority(const fs::path& folder) {
    const std::int64_t now_s = std::time(nullptr);
    const auto made = make_certificate(
        {Kind::kAuthority, "Kinevox private CA", {}, now_s - 300, now_s + kAuthorityDays * kDay}, nullptr);
    if (!made.ok()) return made.status();
    return write_pair(folder, "ca", *made);
}

bool good_file_name(const std::string& name) {
    return !name.empty() && name.size() <= 64 && name.front() != '.' &&
           std::ranges::all_of(
               name, [](unsigned char c) { return std::isalnum(c) || c == '.' || c == '_' || c == '-'; });
}

void print_json(const fs::path& folder, const std::string& name, const std::vector<std::string>& hosts) {
    fmt::print("{}\n", nlohmann::ordered_json({{"ca", (folder / "ca.pem").string()},
                                               {"certificate", (folder / (name + ".pem")).string()},
                                               {"key", (folder / (name + "-key.pem")).string()},
                                               {"hosts", hosts}})
                           .dump());
}

absl::Status issue_server(Arguments& arguments) {
    const fs::path folder = fs::absolute(arguments.out).lexically_normal();
    std::vector<std::string>& hosts = arguments.hosts;
    for (const std::string& own : own_names())
        if (std::ranges::find(hosts, own) == hosts.end()) hosts.push_back(own);
    if (absl::Status issued = issue(folder, "server", {Kind::kServer, hosts.front(), hosts}, arguments.days);
        !issued.ok())
        return issued;
    if (arguments.json)
        print_json(folder, "server", hosts);
    else
        fmt::print(
            "{0} is valid for {1}. Add to kinevoxd.toml:\n\n[server]\ntls_certificate_file = "
            "\"{0}\"\ntls_key_file = "
            "\"{2}\"\n\nClients need {3}: kinevox COMMAND --ca ca.pem ...\n",
            (folder / "server.pem").string(), fmt::join(hosts, ", "), (folder / "server-key.pem").string(),
            (folder / "ca.pem").string());
    return absl::OkStatus();
}

absl::Status init(Arguments& arguments) {
    if (absl::Status made = create_authority(fs::absolute(arguments.out).lexically_normal()); !made.ok())
        return made;
    return issue_server(arguments);
}

absl::Status issue_client(Arguments& arguments) {
    const fs::path folder = fs::absolute(arguments.out).lexically_normal();
    const std::string& name = arguments.name;
    if (!good_file_name(name) || name == "ca" || name == "server")
        return absl::InvalidArgumentError(fmt::format(
            "NAME is '{}'; give 1 to 64 letters, digits and . _ -, other than ca and server", name));
    if (absl::Status issued = issue(folder, name, {Kind::kClient, name, {}}, arguments.days); !issued.ok())
        return issued;
    if (arguments.json)
        print_json(folder, name, {});
    else
        fmt::print("{} and its key: kinevox COMMAND --ca ca.pem --certificate {}.pem --key {}-key.pem ...\n",
                   (folder / (name + ".pem")).string(), name, name);
    return absl::OkStatus();
}

}  // namespace

int main(int argc, char** argv) {
    Arguments arguments;
    CLI::App app("Create a private CA and TLS certificates; existing files are never replaced",
                 "kinevox tls");
    app.require_subcommand(1);
    absl::Status (*act)(Arguments&) = nullptr;
    const auto add = [&](CLI::App& parent, const char* name, const char* help,
                         absl::Status (*run)(Arguments&)) {
        CLI::App* command = parent.add_subcommand(name, help);
        command->add_option("--out", arguments.out, "Folder of the CA and its certificates")
            ->capture_default_str();
        command->add_option("--days", arguments.days, "Validity of the certificate (days)")
            ->capture_default_str()
            ->check(CLI::Range(1, kAuthorityDays));
        command->add_flag("--json", arguments.json, "Print one JSON object");
        command->callback([&act, run] { act = run; });
        return command;
    };
    const auto add_hosts = [&](CLI::App* command) {
        command
            ->add_option("--host", arguments.hosts,
                         "Additional host name or address of the daemon; repeatable")
            ->allow_extra_args(false);
    };
    add_hosts(
        add(app, "init",
            "Create the CA (ca.pem, ca-key.pem) and the daemon's certificate (server.pem, server-key.pem)",
            init));
    CLI::App* const issuing = app.add_subcommand("issue", "Issue a certificate with the CA");
    issuing->require_subcommand(1);
    add_hosts(add(*issuing, "server", "Issue the daemon's certificate again, after the old one was moved",
                  issue_server));
    add(*issuing, "client",
        "Issue a client certificate, NAME.pem and NAME-key.pem, for daemons with [server] tls_client_ca_file",
        issue_client)
        ->add_option("NAME", arguments.name, "Name of the client")
        ->required();
    return tool_main(app, argc, argv, [&]() -> absl::Status {
        if (arguments.out.empty())
            return absl::FailedPreconditionError("no home folder for the certificates; give --out");
        return act(arguments);
    });
}
