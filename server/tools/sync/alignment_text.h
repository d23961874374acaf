// What `kinevox sync` says: a table, JSON, and what its page is drawn from.
#pragma once

#include <nlohmann/json.hpp>
#include <string>

#include "common/session_file.h"
#include "server/sync/align.h"

namespace kinevox::sync {

// Several lines.
std::string table_of(const Session& session, const Alignment& alignment);

// Offsets and deviations, s; pairs; all numbers' units in their names.
nlohmann::ordered_json json_of(const Session& session, const Alignment& alignment);

// The same with the curves and signals that the page shows.
nlohmann::ordered_json page_json_of(const Session& session, const Alignment& alignment);

}  // namespace kinevox::sync
