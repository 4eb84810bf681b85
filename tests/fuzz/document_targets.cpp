// What is signed or decides about trust, and the mission: documents as text.
#include "fuzz/targets.hpp"

#include "fuzz/scratch.hpp"
#include "package/manifest.hpp"
#include "package/mission.hpp"
#include "trust/aircraft_state.hpp"
#include "trust/signed_document.hpp"
#include "trust/rollback_permit.hpp"
#include "trust/root.hpp"

namespace nadir::fuzz {

void root(std::string_view bytes) {
  refusing([&] {
    const SignedRoot first = parse_root(bytes, "fuzz");
    const SignedRoot again = parse_root(first.json(), "again");
    require(again.signed_bytes == first.signed_bytes, "a root changes when it is written");
    require(again.root.version == first.root.version, "a root's version changes");
    check_self(first);
    check_succession(first.root, again);
  });
}

void envelope(std::string_view bytes) {
  refusing([&] {
    const Envelope first = parse_envelope(bytes, "fuzz");
    const Envelope again = parse_envelope(envelope_json(first), "again");
    require(again.payload_type == first.payload_type, "a payload type changes");
    require(again.signatures.size() == first.signatures.size(), "signatures get lost");
  });
}

void manifest(std::string_view bytes) {
  const ManifestReading first = parse_manifest(as_bytes(bytes));
  require(first.manifest.has_value() == first.findings.empty(), "a manifest with findings, or neither");
  if (!first.manifest) return;
  const std::string written = manifest_json(*first.manifest);
  const ManifestReading again = parse_manifest(as_bytes(written));
  require(again.manifest.has_value(), "what was accepted is refused when it is written again");
  require(manifest_json(*again.manifest) == written, "a manifest changes when it is written");
}

void mission(std::string_view bytes) {
  const MissionReading reading = parse_mission(bytes, "fuzz");
  require(reading.mission.has_value() == !reading.findings.refuses(), "a mission with refusals, or neither");
}

void state(std::string_view bytes) {
  const StateReading reading = parse_state(bytes, "fuzz");
  require(reading.state.has_value() == reading.findings.empty(), "a state with findings, or neither");
}

void permit(std::string_view bytes) {
  refusing([&] {
    const SignedPermit first = parse_permit(bytes, "fuzz");
    require(first.permit.to < first.permit.from, "a permit that is no step back");
    const SignedPermit again = parse_permit(first.document.json(), "again");
    require(again.document.signed_bytes == first.document.signed_bytes, "a permit changes when it is written");
  });
}

}  // namespace nadir::fuzz
