// make_posed_trial FOLDER [gaps | people COUNT [NAME...]]: see posed_trial.h. The names are those of 1, 2,
// ...;
// "" is none.
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <string>

#include "tests/support/posed_trial.h"

int main(int argc, char** argv) {
    namespace testing = kinevox::testing;
    if (argc < 2) return 1;
    absl::Status written;
    if (argc > 3 && std::string(argv[2]) == "people") {
        kinevox::SubjectNames names;
        for (int n = 4; n < argc; ++n)
            kinevox::set_subject_name(names, static_cast<std::uint32_t>(n - 3), argv[n]);
        std::filesystem::create_directories(argv[1]);
        written = testing::write_posed_people(argv[1], std::atoi(argv[3]), names);
    } else {
        written = testing::write_posed_trial(argv[1], argc > 2);
    }
    if (!written.ok()) std::fprintf(stderr, "%s\n", std::string(written.message()).c_str());
    return written.ok() ? 0 : 1;
}
