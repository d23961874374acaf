// usage: planted_faults [NAME faulty|correct]     prints the results; without arguments the names
#include <cstdio>
#include <string_view>

#include "tests/cuda/planted_faults.h"

int main(int argc, char** argv) {
    for (const planted_faults::Fault& fault : planted_faults::all()) {
        if (argc < 3) {
            std::printf("%s\n", fault.name);
        } else if (std::string_view(argv[1]) == fault.name) {
            for (const int value : fault.run(std::string_view(argv[2]) == "faulty"))
                std::printf("%d ", value);
            std::printf("\n");
        }
    }
    return 0;
}
