// Output of `kinevox sync`: a table, JSON, and the input of its page.
#pragma once

#include <nlohmann/json.hpp>
#include <string>

#include "common/session_file.h"
#include "server/sync/align.h"

namespace kinevox::sync {

// Several lines.
std::string table_of(const Session& session, const Alignment& alignment);

// Offsets and standard deviations per camera, and pairs; units in the keys.
nlohmann::ordered_json json_of(const Session& session, const Alignment& alignment);

// The same with the curves and signals of the page.
nlohmann::ordered_json page_json_of(const Session& session, const Alignment& alignment);

}  // namespace kinevox::sync
