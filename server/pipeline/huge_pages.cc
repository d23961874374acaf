#include "server/pipeline/huge_pages.h"

#include <cstdlib>

#ifdef __linux__
#include <unistd.h>

#include <filesystem>
#include <system_error>
#endif

namespace kinevox {

void restart_with_huge_pages([[maybe_unused]] char** arguments) {
#ifdef __linux__
    if (std::getenv("GLIBC_TUNABLES")) return;
    // Images and planes come from the heap, not from mappings of their own, which are too small for huge
    // pages and would be returned and cleared again with every frame.
    setenv("GLIBC_TUNABLES",
           "glibc.malloc.hugetlb=1:glibc.malloc.mmap_threshold=67108864:glibc.malloc.top_pad=16777216", 0);
    // By its own path: ps, top and the service manager call a process as the last part of what was executed.
    std::error_code error;
    const std::filesystem::path self = std::filesystem::read_symlink("/proc/self/exe", error);
    if (!error) execv(self.c_str(), arguments);  // returns only where it fails: small pages do as well
#endif
}

}  // namespace kinevox
