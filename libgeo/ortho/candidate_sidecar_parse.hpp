// The strict reader of candidate sidecars, from a document that has been parsed.
#pragma once

#include <nlohmann/json_fwd.hpp>

#include "ortho/candidate_sidecar.hpp"

namespace nadir {

CandidateSidecar read_candidate(const nlohmann::json& document, std::string_view name);  // throws Error

}  // namespace nadir
