#include "server/pipeline/huge_pages.h"

#include <cstdlib>

#ifdef __linux__
#include <unistd.h>
#endif

namespace kinevox {

void restart_with_huge_pages([[maybe_unused]] char** arguments) {
#ifdef __linux__
    if (std::getenv("GLIBC_TUNABLES")) return;
    // Pictures and planes come from the heap, not from mappings of their own, which are too small for huge
    // pages and would be returned and cleared again with every frame.
    setenv("GLIBC_TUNABLES",
           "glibc.malloc.hugetlb=1:glibc.malloc.mmap_threshold=67108864:glibc.malloc.top_pad=16777216", 0);
    execv("/proc/self/exe", arguments);  // returns only where it fails: small pages do as well
#endif
}

}  // namespace kinevox
