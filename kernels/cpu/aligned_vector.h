// std::vector whose storage begins on a cache line, so that a vector register's load never straddles two.
// Large ones ask for huge pages: the background's samples are read here and there, and a miss of the TLB
// would cost as much as the samples themselves.
#pragma once

#include <cstddef>
#include <new>
#include <vector>

#ifdef __linux__
#include <sys/mman.h>
#endif

namespace kinevox::kernels::cpu {

template <class T>
struct CacheLineAllocator {
    using value_type = T;
    static constexpr std::size_t kCacheLine = 64, kHugePage = std::size_t{2} << 20;
    static constexpr std::align_val_t alignment(std::size_t bytes) {
        return std::align_val_t{bytes >= kHugePage ? kHugePage : kCacheLine};
    }

    CacheLineAllocator() = default;
    template <class U>
    CacheLineAllocator(const CacheLineAllocator<U>&) {}

    T* allocate(std::size_t count) {
        const std::size_t bytes = count * sizeof(T);
        void* memory = ::operator new(bytes, alignment(bytes));
#if defined(__linux__) && defined(MADV_HUGEPAGE)
        if (bytes >= kHugePage) madvise(memory, bytes / kHugePage * kHugePage, MADV_HUGEPAGE);  // only a hint
#endif
        return static_cast<T*>(memory);
    }
    void deallocate(T* memory, std::size_t count) {
        ::operator delete(memory, alignment(count * sizeof(T)));
    }
    bool operator==(const CacheLineAllocator&) const {
        return true;
    }
};

template <class T>
using AlignedVector = std::vector<T, CacheLineAllocator<T>>;

}  // namespace kinevox::kernels::cpu
