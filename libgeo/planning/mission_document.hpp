// A mission as a JSON document: the members of mission.yaml (schemas/mission.schema.json), for programs that edit it.
//
// A document may be a draft: members may be missing or wrong. Since JSON is YAML, a document is read as a mission file
// is, and what is wrong with it is named by its path: "route.points[2]".
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>

#include "package/mission.hpp"

namespace nadir {

// read_document(document_from(mission)) is the mission, to the last bit of every number.
nlohmann::json document_from(const Mission& mission);

// Usual values and no ground yet: without a take-off point, sectors or a route's points.
nlohmann::json new_document(const std::string& id, UtcTime today);

// The `where` of each finding is a path in the document; "" for the document itself.
MissionReading read_document(const nlohmann::json& document);

}  // namespace nadir
