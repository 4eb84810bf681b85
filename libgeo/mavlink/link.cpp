#include "mavlink/link.hpp"

#include <utility>

namespace nadir {
namespace {

// So often that a flood of recorded frames does not keep the peer's own from being answered.
constexpr std::int64_t kChallenge_us = 50'000;

}  // namespace

MavlinkLink::MavlinkLink(std::unique_ptr<Transport> transport, MavlinkAddress own, std::optional<Signing> signing,
                         std::optional<MavlinkAddress> peer)
    : transport_(std::move(transport)), own_(own), signing_(std::move(signing)), peer_(peer) {}

bool MavlinkLink::advance(std::int64_t monotonic_us, const std::function<void(const ReceivedMessage&)>& handle,
                          const std::function<void(MavlinkAddress)>& rejected) {
  return transport_->advance(monotonic_us, [&](const Transport::Arrival& arrival) {
    reader_.add(arrival.bytes);
    if (arrival.whole || arrival.lost) reader_.finish();
    drain(monotonic_us, handle, rejected);
  });
}

void MavlinkLink::drain(std::int64_t monotonic_us, const std::function<void(const ReceivedMessage&)>& handle,
                        const std::function<void(MavlinkAddress)>& rejected) {
  while (const auto frame = reader_.next()) {
    if (frame->source == own_) continue;
    const bool is_peer = !peer_ || frame->source == *peer_;
    const auto verdict = signing_ ? signing_->check(*frame, monotonic_us) : SignatureVerdict::accepted;
    if (verdict != SignatureVerdict::accepted) {
      if (is_peer && verdict == SignatureVerdict::replayed) challenge(*frame, monotonic_us);
      if (rejected) rejected(frame->source);
      continue;
    }
    if (is_peer && !transport_->follow_sender(monotonic_us)) {
      ++counts_.rivals;
      if (peer_) continue;  // with signatures too: a key may be stolen
    }
    if (is_peer) accepted_us_ = monotonic_us;
    auto message = decode(*frame);
    if (!message) {
      ++counts_.malformed;
      continue;
    }
    ++counts_.messages;
    handle({frame->source, signing_.has_value(), monotonic_us, std::move(*message)});
  }
}

void MavlinkLink::challenge(const MavlinkFrame& replayed, std::int64_t monotonic_us) {
  if (accepted_us_ && monotonic_us - *accepted_us_ < kPeerSilence_us) return;
  if (monotonic_us < next_challenge_us_) return;
  next_challenge_us_ = monotonic_us + kChallenge_us;
  const Bytes heartbeat = encode(OwnHeartbeat{SystemState::boot}, own_, sequence_++);
  if (transport_->answer_sender(signing_->sign_answer(heartbeat, replayed, monotonic_us))) ++counts_.sent;
}

bool MavlinkLink::send(const OutgoingMessage& message, std::int64_t monotonic_us) {
  Bytes frame = encode(message, own_, sequence_++);
  if (signing_) frame = signing_->sign(std::move(frame), monotonic_us);
  const bool sent = transport_->send(frame);
  counts_.sent += sent ? 1 : 0;
  return sent;
}

LinkCounts MavlinkLink::counts() const {
  LinkCounts counts = counts_;
  counts.frames = reader_.counts();
  counts.transport = transport_->counts();
  if (signing_) counts.signatures = signing_->counts();
  return counts;
}

}  // namespace nadir
