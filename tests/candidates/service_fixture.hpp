// A candidate service in a folder, with two airframes that it trusts, a client, and the steps of an upload.
#pragma once

#include <gtest/gtest.h>

#include "base/files.hpp"
#include "candidates/candidate_service.hpp"
#include "candidates/flight_maker.hpp"
#include "support/temporary_folder.hpp"

namespace nadir::test {

class ServiceFixture : public ::testing::Test {
 protected:
  void SetUp() override {
    write_root();
    options_.data = folder_ / "data";
    std::filesystem::create_directories(options_.data);
    options_.catalogue = parse_catalogue_location((options_.data / "catalogue.sqlite").string());
    options_.trust = folder_ / "root.json";
    options_.packs.keep_free_bytes = 0;
  }

  CandidateService& service() {
    if (!service_) service_.emplace(options_, clock_);
    return *service_;
  }
  // As after a kill: only what is on the disk.
  CandidateService& restarted() {
    service_.reset();
    service().recover();
    return *service_;
  }

  void write_root(std::int64_t version = 1, const std::set<std::string>& revoked = {}) {
    write_file_atomic(folder_ / "root.json", root_text({&first_, &second_}, signer_, version, revoked));
  }

  Answer<Announcement> announce(const SignedBatch& batch) {
    return service().announce(client_, batch.batch.id, batch.json());
  }
  Announcement announced(const SignedBatch& batch) {
    auto answer = announce(batch);
    if (const auto* denial = std::get_if<Denial>(&answer)) ADD_FAILURE() << denial->detail;
    return std::holds_alternative<Announcement>(answer) ? std::get<Announcement>(answer) : Announcement();
  }
  Answer<PackOffset> send(const std::string& upload, ByteView pack, std::uint64_t from = 0, std::uint64_t bytes = ~0ULL,
                          std::optional<Sha256> name = {}) {
    const ByteView part = pack.subspan(from, std::min<std::uint64_t>(bytes, pack.size() - from));
    return service().append(client_, upload, name.value_or(sha256(pack)),
                            {.offset = from, .length = pack.size(), .digest = sha256(part)}, part);
  }
  void judge_all() {
    for (const auto& [client, upload] : service().pending_evaluations()) {
      while (service().evaluate_some(upload)) {
      }
    }
    while (service().vote_some()) {
    }
  }
  // The whole way; the verdicts, in the order of the candidates.
  std::vector<TileRow> upload(const FlightMaker& flight, const std::vector<Candidate>& candidates, int number = 1) {
    const Announcement announcement = announced(flight.batch(candidates, number));
    std::vector<Candidate> wanted;
    for (const Candidate& candidate : candidates) {
      const auto& missing = announcement.missing;
      if (std::find(missing.begin(), missing.end(), candidate.sidecar.sha256) != missing.end())
        wanted.push_back(candidate);
    }
    if (!wanted.empty()) {
      const auto sent = send(announcement.upload, pack_of(wanted));
      if (const auto* denial = std::get_if<Denial>(&sent)) ADD_FAILURE() << denial->detail;
    }
    std::optional<std::int64_t> pending_evaluations;
    const auto completed = service().complete(client_, announcement.upload, pending_evaluations);
    if (const auto* denial = std::get_if<Denial>(&completed)) ADD_FAILURE() << denial->detail;
    judge_all();
    return verdicts(announcement.upload);
  }
  // Sent and complete; the upload, which is not evaluated yet.
  std::int64_t complete(const FlightMaker& flight, const std::vector<Candidate>& candidates, int number) {
    const std::string name = announced(flight.batch(candidates, number)).upload;
    EXPECT_TRUE(std::holds_alternative<PackOffset>(send(name, pack_of(candidates))));
    std::optional<std::int64_t> pending_evaluation;
    service().complete(client_, name, pending_evaluation);
    EXPECT_TRUE(pending_evaluation);
    return pending_evaluation.value_or(0);
  }
  void accepted(const FlightMaker& flight, const std::vector<Candidate>& candidates, int number) {
    const std::int64_t before = service().counts().accepted;
    ASSERT_FALSE(service().evaluate_some(complete(flight, candidates, number)));
    ASSERT_EQ(service().counts().accepted, before + std::ssize(candidates));
  }
  std::vector<TileRow> verdicts(const std::string& upload) {
    const auto status = service().status(client_, upload);
    return std::get<UploadStatus>(status).tiles;
  }
  static std::vector<Candidate> candidates(const FlightMaker& flight, const std::vector<TileKey>& keys) {
    std::vector<Candidate> list;
    for (const TileKey& key : keys) list.push_back(flight.candidate(key));
    return list;
  }

  TemporaryFolder folder_;
  FixedClock clock_{UtcTime{kNoon.unix_s + 3600}};
  PrivateKey signer_ = PrivateKey::generate();
  FlightMaker first_{{.airframe = "mini-07", .flight = "flight-1", .noise = 1}};
  FlightMaker second_{{.airframe = "mini-08", .flight = "flight-2", .noise = 2}};
  UploadClient client_{.name = "ground-1", .airframes = {}};
  CandidateServiceOptions options_;
  std::optional<CandidateService> service_;
};

// The code of a tile that was rejected; "" for the others.
inline std::string code_of(const TileRow& tile) {
  return tile.code && tile.verdict == Verdict::rejected ? std::string(name_of(*tile.code)) : std::string();
}

}  // namespace nadir::test
