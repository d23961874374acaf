#include "server/tools/calibrate/console.h"

#include <fmt/format.h>

#include <atomic>
#include <memory>

#include "common/progress_line.h"
#include "server/tools/interrupt.h"

namespace kinevox::calibrate {

namespace {

struct Console {
    explicit Console(bool quiet) : line(quiet) {}
    ProgressLine line;
    std::atomic<bool> interrupted = false;
    Interrupt interrupt{[this] { interrupted = true; }};  // last: its thread ends first
};

}  // namespace

SolveProgress console_progress(bool quiet) {
    return [console = std::make_shared<Console>(quiet)](double fraction, const std::string& what) {
        if (console->interrupted) {
            console->line.clear();
            return false;
        }
        if (fraction >= 1)
            console->line.clear();
        else if (console->line.due())
            console->line.draw(fmt::format("{:3.0f} %  {}", 100 * fraction, what));
        return true;
    };
}

}  // namespace kinevox::calibrate
