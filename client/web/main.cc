// kinevox-web: serves the exhibit page and the daemon's streams to browsers.
#include <fmt/format.h>
#include <google/protobuf/stubs/logging.h>
#include <grpc/support/log.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <cstdio>
#include <filesystem>
#include <string>

#include "client/lib/client_program.h"
#include "client/web/gateway.h"
#include "common/command_line.h"

namespace {

using namespace kinevox;

// Relative to the executable: the installed folder, else that of the build.
std::string default_pages() {
    std::error_code e;
    const auto folder = std::filesystem::read_symlink("/proc/self/exe", e).parent_path();
    for (const char* name : {"../share/kinevox/exhibit", "../exhibit/page"})
        if (const auto pages = (folder / name).lexically_normal();
            std::filesystem::exists(pages / "index.html", e))
            return pages.string();
    return (folder / "../share/kinevox/exhibit").lexically_normal().string();
}

absl::Status serve(web::GatewayOptions options, const client::ConnectionOptions& connection,
                   const std::string& page_folder) {
    const auto daemon = connection.open();
    if (!daemon.ok()) return daemon.status();
    options.daemon = *daemon;
    options.max_connections = 4 * options.max_clients;
    auto pages = web::Pages::read(page_folder);
    if (!pages.ok()) return pages.status();
    const auto gateway = web::Gateway::open(options, *std::move(pages));
    if (!gateway.ok()) return gateway.status();
    fmt::print("ready on {}\n", (*gateway)->address());
    std::fflush(stdout);
    (*gateway)->run();
    return absl::OkStatus();
}

}  // namespace

int main(int argc, char** argv) {
    gpr_set_log_function([](gpr_log_func_args*) {});  // errors are reported from their statuses
    google::protobuf::SetLogHandler(nullptr);         // invalid messages are answered with an error
    web::GatewayOptions options;
    client::ConnectionOptions connection;
    std::string page_folder = default_pages();
    CLI::App app(
        "Serve the exhibit page and the daemon's poses, volumes and silhouettes to browsers, never camera "
        "images.",
        "kinevox-web");
    app.set_version_flag("--version", std::string("kinevox-web ") + KINEVOX_VERSION);
    client::add_connection_options(app, connection);
    app.add_option("--listen", options.listen, "HOST:PORT for browsers (port 0: a free port)")
        ->capture_default_str();
    app.add_option("--page-dir", page_folder, "Folder of the page's files")
        ->type_name("DIR")
        ->capture_default_str();
    app.add_option("--allow-host", options.rules.allowed_hosts, "Additional Host name to accept; repeatable");
    app.add_option("--allow-origin", options.rules.allowed_origins,
                   "Additional Origin to accept, like http://kiosk.local:8000; repeatable");
    app.add_flag("--show-names", options.show_names, "Show the names that operators gave the subjects");
    app.add_option("--max-clients", options.max_clients, "Maximum simultaneous browsers")
        ->check(CLI::Range(1, 1000))
        ->capture_default_str();
    return tool_main(app, argc, argv, [&] { return serve(options, connection, page_folder); });
}
