// Replaces Protocol Buffers' header of this name under ThreadSanitizer, where it adds two members to maps.
// Debian's library is built without the sanitizer and would read other members' bytes.
#pragma once

// The headers that it includes, with the sanitizer.
#include <google/protobuf/arena.h>
#include <google/protobuf/message.h>

#include <atomic>
#include <functional>
#include <memory>
#include <mutex>

#pragma push_macro("__SANITIZE_THREAD__")
#undef __SANITIZE_THREAD__
#include_next <google/protobuf/map_field.h>
#pragma pop_macro("__SANITIZE_THREAD__")
