// kinevox-web: the exhibit's page and what it shows, for browsers.
#include <fmt/format.h>
#include <google/protobuf/stubs/logging.h>
#include <grpc/support/log.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <cstdio>
#include <filesystem>
#include <string>

#include "client/lib/connection_options.h"
#include "client/web/gateway.h"

namespace {

using namespace kinevox;

// Beside the program: as installed, else as built.
std::string default_pages() {
    std::error_code e;
    const auto folder = std::filesystem::read_symlink("/proc/self/exe", e).parent_path();
    for (const char* place : {"../share/kinevox/exhibit", "../exhibit/page"})
        if (const auto pages = (folder / place).lexically_normal();
            std::filesystem::exists(pages / "index.html", e))
            return pages.string();
    return (folder / "../share/kinevox/exhibit").lexically_normal().string();
}

int fail(const absl::Status& status) {
    fmt::print(stderr, "kinevox-web: {}\n", std::string(status.message()));
    return 1;
}

}  // namespace

int main(int argc, char** argv) {
    gpr_set_log_function([](gpr_log_func_args*) {});  // errors come back as statuses; one line each is enough
    google::protobuf::SetLogHandler(nullptr);         // what browsers send wrongly is answered to them
    web::GatewayOptions options;
    client::ConnectionOptions connection;
    std::string pages_folder = default_pages();
    CLI::App app(
        "Serves the exhibit's page and the daemon's poses, volumes and silhouettes to browsers, never camera "
        "pictures.",
        "kinevox-web");
    app.set_version_flag("--version", std::string("kinevox-web ") + KINEVOX_VERSION);
    app.failure_message([](const CLI::App*, const CLI::Error& error) {
        return "kinevox-web: " + std::string(error.what()) + "\n";
    });
    client::add_connection_options(app, connection);
    app.add_option("--listen", options.listen, "HOST:PORT to serve browsers on; port 0 takes a free one")
        ->capture_default_str();
    app.add_option("--pages", pages_folder, "Folder of the page's files")
        ->type_name("DIR")
        ->capture_default_str();
    app.add_option("--name", options.rules.names,
                   "A name that browsers may call this machine by, besides its addresses and localhost; may "
                   "be repeated");
    app.add_option("--origin", options.rules.origins,
                   "Another page whose scripts may connect, like http://kiosk.local:8000; may be repeated");
    app.add_option("--browsers", options.max_browsers, "Browsers at a time, at most")
        ->check(CLI::Range(1, 1000))
        ->capture_default_str();
    CLI11_PARSE(app, argc, argv);
    const auto daemon = connection.open();
    if (!daemon.ok()) return fail(daemon.status());
    options.daemon = *daemon;
    options.max_connections = 4 * options.max_browsers;

    auto pages = web::Pages::read(pages_folder);
    if (!pages.ok()) return fail(pages.status());
    const auto gateway = web::Gateway::open(options, *std::move(pages));
    if (!gateway.ok()) return fail(gateway.status());
    fmt::print("ready on {}\n", (*gateway)->address());
    std::fflush(stdout);
    (*gateway)->run();
    return 0;
}
