// Computes a value per key once for any number of threads, and shares it.
#pragma once

#include <map>
#include <memory>
#include <mutex>
#include <utility>

namespace kinevox {

// get() by any thread. A second caller for the same key waits for the first; callers for other keys do not.
template <typename Key, typename Value>
class OnceMap {
  public:
    template <typename Make>
    std::shared_ptr<const Value> get(const Key& key, const Make& make) const {
        std::shared_ptr<Slot> slot;
        {
            const std::scoped_lock lock(mutex_);
            std::shared_ptr<Slot>& entry = slots_[key];
            if (!entry) entry = std::make_shared<Slot>();
            slot = entry;
        }
        std::call_once(slot->once, [&] { slot->value = std::make_shared<const Value>(make()); });
        return slot->value;
    }

  private:
    struct Slot {
        std::once_flag once;
        std::shared_ptr<const Value> value;
    };
    mutable std::mutex mutex_;
    mutable std::map<Key, std::shared_ptr<Slot>> slots_;
};

}  // namespace kinevox
