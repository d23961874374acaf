// make_posed_trial FOLDER [gaps]: see posed_trial.h.
#include <cstdio>
#include <string>

#include "tests/support/posed_trial.h"

int main(int argc, char** argv) {
    if (argc < 2) return 1;
    const absl::Status written = kinevox::testing::write_posed_trial(argv[1], argc > 2);
    if (!written.ok()) std::fprintf(stderr, "%s\n", std::string(written.message()).c_str());
    return written.ok() ? 0 : 1;
}
