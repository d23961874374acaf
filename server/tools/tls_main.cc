// kinevox tls: a private certificate authority, and certificates of it for the daemon and its clients.
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <ctime>
#include <string>
#include <vector>

#include "common/atomic_file.h"
#include "common/state_folder.h"
#include "server/access/certificates.h"
#include "server/access/private_file.h"

namespace {

using namespace kinevox;
namespace fs = std::filesystem;
using Kind = NewCertificate::Kind;

constexpr std::int64_t kDay = 86'400;
constexpr int kAuthorityDays = 3650;

int fail(std::string message) {
    std::ranges::replace(message, '\n', ' ');
    fmt::print(stderr, "kinevox tls: {}\n", message);
    return 1;
}

int fail(const absl::Status& status) {
    return fail(std::string(status.message()));
}

// Where other machines find this one, as far as it knows.
std::vector<std::string> own_names() {
    std::vector<std::string> names{"localhost", "127.0.0.1", "::1"};
    char host[256] = "";
    if (gethostname(host, sizeof host - 1) == 0 && *host && std::ranges::find(names, host) == names.end())
        names.insert(names.begin(), host);
    return names;
}

// NAME.pem and NAME-key.pem; neither where one is there already.
absl::Status write_pair(const fs::path& folder, const std::string& name, const CertificateAndKey& made) {
    const fs::path certificate = folder / (name + ".pem"), key = folder / (name + "-key.pem");
    for (const fs::path& file : {certificate, key})
        if (std::error_code ignored; fs::exists(file, ignored))
            return absl::AlreadyExistsError(
                fmt::format("{} is there already and is not replaced; move it away, or give another --out",
                            file.string()));
    if (absl::Status written = write_private_file(key, made.key, Existing::kKeep); !written.ok())
        return written;
    if (absl::Status written = write_private_file(certificate, made.certificate, Existing::kKeep);
        !written.ok())
        return written;
    std::error_code ignored;  // certificates are no secret
    fs::permissions(certificate, fs::perms::group_read | fs::perms::others_read, fs::perm_options::add,
                    ignored);
    return absl::OkStatus();
}

absl::StatusOr<CertificateAndKey> read_authority(const fs::path& folder) {
    auto certificate = read_file(folder / "ca.pem"), key = read_file(folder / "ca-key.pem");
    if (!certificate.ok() || !key.ok())
        return absl::NotFoundError(fmt::format(
            "{} holds no ca.pem and ca-key.pem; run kinevox tls init, or give --out", folder.string()));
    return CertificateAndKey{*std::move(certificate), *std::move(key)};
}

absl::Status make(const fs::path& folder, const std::string& file, NewCertificate wanted, int days) {
    auto authority = read_authority(folder);
    if (!authority.ok()) return authority.status();
    wanted.from_s = std::time(nullptr) - 300;  // clocks that are a little behind
    wanted.until_s = std::time(nullptr) + days * kDay;
    const auto made = make_certificate(wanted, &*authority);
    if (!made.ok()) return made.status();
    return write_pair(folder, file, *made);
}

absl::Status make_authority(const fs::path& folder) {
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

int tell_server(const fs::path& folder, const std::vector<std::string>& hosts) {
    fmt::print(
        "{0} is for {1}. For kinevoxd.toml:\n\n[server]\ncertificate = \"{0}\"\nkey = \"{2}\"\n\n"
        "Clients need {3}: kinevox VERB --ca ca.pem ...\n",
        (folder / "server.pem").string(), fmt::join(hosts, ", "), (folder / "server-key.pem").string(),
        (folder / "ca.pem").string());
    return 0;
}

}  // namespace

int main(int argc, char** argv) {
    std::string out = in_state_folder("tls").string(), name;
    std::vector<std::string> hosts;
    int days = 825;
    CLI::App app(
        "Certificates for a daemon that other machines reach, of a private authority of its own. Keys are "
        "readable by "
        "their "
        "owner alone; nothing is replaced.",
        "kinevox tls");
    app.require_subcommand(1);
    const auto add = [&](const char* verb, const char* what) {
        CLI::App* sub = app.add_subcommand(verb, what);
        sub->add_option("--out", out, "The folder of the authority and its certificates")
            ->capture_default_str();
        sub->add_option("--days", days, "How long the certificate is valid")
            ->capture_default_str()
            ->check(CLI::Range(1, kAuthorityDays));
        return sub;
    };
    const auto add_hosts = [&](CLI::App* sub) {
        sub->add_option(
            "--host", hosts,
            "A name or address that clients reach the daemon by, beside this machine's own; may be repeated");
    };
    CLI::App* const init = add(
        "init",
        "Makes the authority (ca.pem, ca-key.pem) and the daemon's certificate (server.pem, server-key.pem)");
    add_hosts(init);
    CLI::App* const server =
        add("server", "Makes the daemon's certificate anew, when the old one is moved away");
    add_hosts(server);
    CLI::App* const client = add("client",
                                 "Makes a client's certificate, NAME.pem and NAME-key.pem, for daemons that "
                                 "ask for one ([server] client_ca)");
    client->add_option("name", name, "Whose it is")->required();
    try {
        app.parse(argc, argv);
    } catch (const CLI::ParseError& error) {
        if (error.get_exit_code() == 0) return app.exit(error);
        return fail(std::string(error.what()) + "; see kinevox tls --help");
    }
    if (out.empty()) return fail("there is no home to keep the certificates in; give --out");
    const fs::path folder = fs::absolute(out).lexically_normal();
    if (client->parsed()) {
        if (!good_file_name(name) || name == "ca" || name == "server")
            return fail(fmt::format(
                "the name '{}' is not 1 to 64 letters, digits and . _ -, or is taken; give another", name));
        const absl::Status made = make(folder, name, {Kind::kClient, name, {}}, days);
        if (!made.ok()) return fail(made);
        fmt::print("{} and its key: kinevox VERB --ca ca.pem --certificate {}.pem --key {}-key.pem ...\n",
                   (folder / (name + ".pem")).string(), name, name);
        return 0;
    }
    for (const std::string& own : own_names())
        if (std::ranges::find(hosts, own) == hosts.end()) hosts.push_back(own);
    if (init->parsed())
        if (const absl::Status made = make_authority(folder); !made.ok()) return fail(made);
    const absl::Status made = make(folder, "server", {Kind::kServer, hosts.front(), hosts}, days);
    return made.ok() ? tell_server(folder, hosts) : fail(made);
}
