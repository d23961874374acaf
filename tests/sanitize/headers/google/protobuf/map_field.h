// In the place of Protocol Buffers' header of this name under the thread sanitizer: it gives maps two more
// members there, of which Debian's library, built without the sanitizer, knows nothing; whoever asked it for
// a map's entries got another member's bytes.
#pragma once

// What the header includes, as the sanitizer wants it.
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
