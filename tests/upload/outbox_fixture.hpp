// An outbox in a folder of its own, a few candidates, and answers about them.
#pragma once

#include <gtest/gtest.h>

#include <map>
#include <optional>
#include <vector>

#include "ortho/sample_candidates.hpp"
#include "support/temporary_folder.hpp"
#include "upload/staging.hpp"
#include "upload/transfer.hpp"

namespace nadir::test {

class OutboxFixture : public ::testing::Test {
 protected:
  const Candidate& candidate(int number) {
    auto found = made_.find(number);
    if (found == made_.end()) {
      const TileKey at{19, 278'000 + static_cast<std::uint32_t>(number), 182'000};
      found = made_.emplace(number, sample_candidate(key_, at, number)).first;
    }
    return found->second;
  }
  std::int64_t stage(int count) {
    std::vector<Candidate> candidates;
    for (int i = 0; i < count; ++i) candidates.push_back(candidate(i));
    return stage_candidates(*outbox_, candidates, 1);
  }
  SealedSum seal() {
    return seal_batches(*outbox_, key_, 1'795'000'000'000, [this] {
      std::array<std::uint8_t, 16> bytes{};
      bytes[0] = ++uuids_;
      return bytes;
    });
  }
  // Numbers of candidates that the service lacks, has, and refuses.
  AnnouncementReply answer(const std::vector<int>& missing, const std::vector<int>& known,
                           const std::vector<int>& refused) {
    AnnouncementReply answer{"upload-01", {}, {}, {}, 65'536, {1'800'000'000}};
    for (const int i : missing) answer.missing.push_back(candidate(i).sidecar.sha256);
    for (const int i : known) answer.known.push_back(candidate(i).sidecar.sha256);
    for (const int i : refused) answer.refused.push_back({candidate(i).sidecar.sha256, "too_old", ""});
    return answer;
  }
  StatusReply verdicts(const OpenBatch& batch, const std::vector<VerdictReply::Kind>& kinds) {
    StatusReply status{"upload-01", batch.uuid, true, {}};
    for (std::size_t i = 0; i < kinds.size(); ++i) {
      const bool rejected = kinds[i] == VerdictReply::Kind::rejected;
      status.tiles.push_back({candidate(static_cast<int>(i)).sidecar.sha256, kinds[i], rejected ? "blurred" : "", ""});
    }
    return status;
  }
  std::int64_t tiles_in(TileState state) {
    auto count = outbox_->prepare("SELECT count(*) FROM tile WHERE state = ?");
    count.bind(1, name_of(state)).step();
    return count.integer(0);
  }

  // Whatever its triggers say.
  void change(const std::string& sql) {
    outbox_.reset();
    const SqliteDatabase database = SqliteDatabase::open_writable(file_);
    auto triggers = database.prepare("SELECT name, sql FROM sqlite_master WHERE type = 'trigger'");
    std::map<std::string, std::string> kept;
    while (triggers.step()) kept.emplace(triggers.text(0), triggers.text(1));
    triggers.reset();
    for (const auto& [name, text] : kept) database.execute("DROP TRIGGER " + name);
    database.execute(sql);
    for (const auto& [name, text] : kept) database.execute(text);
  }
  void reopen() { outbox_.emplace(folder_ / "outbox", OutboxDatabase::Access::write); }

  TemporaryFolder folder_;
  const std::filesystem::path file_ = folder_ / "outbox" / kOutboxFile;
  PrivateKey key_ = PrivateKey::generate();
  std::map<int, Candidate> made_;
  std::uint8_t uuids_ = 0;
  std::optional<OutboxDatabase> outbox_{std::in_place, folder_ / "outbox", OutboxDatabase::Access::make};
  Transfer transfer_{*outbox_};
};

}  // namespace nadir::test
