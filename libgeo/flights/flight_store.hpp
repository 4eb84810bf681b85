// A flight on disk: a folder with flight.sqlite and pictures/ (docs/flights.md, docs/formats/flight.md).
//
//   flight        what it is localized with: camera, package or none, start or none, configuration
//   pictures      every picture that was offered: accepted (it has a frame number), processed, or refused and why
//   measurements  what vision found in a frame (recorded_vision.hpp)
//   estimates     where each frame was: online as it was processed, refined with the whole flight, adjusted
//   poses         attitudes, heights and the lens by the adjustment (adjusted_poses.hpp)
//   segments      stretches over which odometry did not break (segment_tracker.hpp)
//   fixes         where a person said that a frame was taken (flight_annotations.hpp)
//   objects       what a person marked in the pictures
//   events        all that happened, in order, each with a number: whoever lost the connection asks for those after the
//                 last number that he has
//
// What has been accepted survives a kill at any moment, and with StoreSync::every_commit a loss of power: pictures are
// synced before they get their names, and one transaction makes a batch, or a frame, part of the flight. A picture file
// that no transaction mentions was on its way when the process died; opening removes it.
//
// One process at a time: a lock keeps others out. All functions are safe from several threads; a batch that is being
// stored does not delay the frame that is being processed.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "base/bytes.hpp"
#include "base/time.hpp"
#include "estimation/estimate.hpp"
#include "estimation/telemetry.hpp"
#include "flights/adjusted_poses.hpp"
#include "flights/flight_annotations.hpp"
#include "flights/flight_database.hpp"
#include "flights/flight_rows.hpp"
#include "flights/picture_intake.hpp"
#include "flights/segment_tracker.hpp"
#include "geodesy/lon_lat.hpp"
#include "recorder/records.hpp"

namespace nadir {

inline constexpr std::string_view kPicturesFolder = "pictures";

struct FlightStoreOptions {
  StoreSync sync = StoreSync::every_commit;
  PictureLimits limits;
  // Where the pictures lie of a flight that refers to a folder (FlightStore::refer()). A flight from somebody else must
  // not choose which files are read here: what its database says is not used.
  std::optional<std::filesystem::path> outside;
  FlightCommitHook hook;
};

// A frame to be processed. Until put_frame() or abandon_frame() no other is begun.
struct BegunFrame {
  std::size_t frame = 0;
  Telemetry telemetry;
  std::vector<UserFix> fixes;
};

class FlightStore {
 public:
  // A new flight. The folder is created; what an earlier create() that was killed left in it is replaced. Throws
  // UsageError when it holds a flight, Error, OutOfSpace.
  static std::unique_ptr<FlightStore> create(const std::filesystem::path& folder, const FlightDescription& description,
                                             UtcMillis now, const FlightStoreOptions& options = {});
  // Throws UsageError when there is no flight, when another process has it, for another version's, and when its
  // pictures lie outside and options.outside does not say where.
  static std::unique_ptr<FlightStore> open(const std::filesystem::path& folder, const FlightStoreOptions& options = {});
  // Without a folder: for flights that nobody will resume. Its pictures lie elsewhere (refer()).
  static std::unique_ptr<FlightStore> in_memory(const FlightDescription& description, UtcMillis now);
  static bool exists(const std::filesystem::path& folder);

  ~FlightStore();
  FlightStore(const FlightStore&) = delete;
  FlightStore& operator=(const FlightStore&) = delete;

  const FlightDescription& description() const;

  // ---- Pictures

  // A batch, in the order of time: one answer for each picture, in the same order. All that are accepted become part of
  // the flight at once, when this returns. Throws UsageError for more pictures than a batch may have, Error and
  // OutOfSpace, and then none of them does.
  std::vector<PictureAnswer> accept(std::span<const PictureOffer> batch, UtcMillis now);
  // Pictures that stay where they are: files of a folder, whose names are those of the telemetry's frames or `files`.
  // They are not examined, and one that cannot be read is an unfit frame. Once, for a flight without pictures.
  void refer(const std::filesystem::path& folder, std::span<const Telemetry> frames, std::span<const std::string> files,
             UtcMillis now);

  std::size_t accepted() const;   // frames 0 to accepted() - 1
  std::size_t processed() const;  // of these, from 0
  PictureRow picture(std::size_t frame) const;
  std::vector<PictureRow> refused() const;
  // The encoded bytes. Throws Error when a kept picture is missing or its bytes are not those that were accepted. Of a
  // picture outside: nothing when it cannot be read, Error when its size is not what it was when it was processed.
  Bytes read_picture(std::size_t frame) const;

  // ---- Processing

  // The next frame, or nothing while there is none. Fixes that are added from now on are for the frame after it.
  std::optional<BegunFrame> begin_frame();
  void put_frame(const ProcessedFrame& frame, UtcMillis now);  // the begun one, in one transaction
  void abandon_frame();                                        // the begun one will be begun again
  StoredFrame stored_frame(std::size_t frame) const;
  AnchorReport look_of(std::size_t frame) const;  // at the map, of a processed frame; without its images
  std::vector<UserFix> fixes_before(std::size_t frame) const;

  // Its id, its time and the frame that it is applied before are decided here. Throws UsageError for an invalid place,
  // radius or pixel.
  UserFix add_fix(UserFix said, UtcMillis now);
  // The aircraft was within this radius.
  UserFix add_fix(const LonLat& place, double radius_m, std::string_view by, UtcMillis now);
  // It is not used from the next frame on. Nothing: there is no such fix. One that is withdrawn already stays as it is.
  std::optional<UserFix> withdraw_fix(std::int64_t id, UtcMillis now);

  // Throw UsageError for more objects or sightings than there may be, and pixels that are no numbers. Nothing, false:
  // there is no such object or sighting.
  MarkedObject add_object(std::string_view name, const MarkedSighting& first, std::string_view by, UtcMillis now);
  std::optional<MarkedObject> add_sighting(std::int64_t object, const MarkedSighting& sighting, UtcMillis now);
  std::optional<MarkedObject> rename_object(std::int64_t id, std::string_view name, UtcMillis now);
  bool remove_object(std::int64_t id, UtcMillis now);
  bool remove_sighting(std::int64_t object, std::int64_t sighting, UtcMillis now);  // UsageError: it is the last one

  // All frames' estimates of a kind other than online; they replace those of that kind. events: appended. Adjusted ones
  // have no poses then.
  void put_estimates(EstimateKind kind, std::span<const Estimate> estimates, std::span<const StoredFlightEvent> events,
                     UtcMillis now);
  // Adjusted estimates, and the poses that belong to them, in one transaction.
  void put_adjustment(std::span<const Estimate> estimates, const AdjustedPoses& poses,
                      std::span<const StoredFlightEvent> events, UtcMillis now);
  void append_event(const StoredFlightEvent& event, UtcMillis now);
  // Unless the same one was appended before: for what is done again after a kill.
  void append_event_once(const StoredFlightEvent& event, UtcMillis now);

  // A floating segment was placed as a whole (segment_placement.hpp): estimates of all of its frames, which are shown
  // as refined ones from now on. basis: segments that it was placed by, by ground that both show. False, and nothing is
  // stored: it has changed meanwhile, so has one of these, or a person has taken it back.
  bool merge_segment(const FlightSegment& floating, std::span<const EstimateRecord> placed,
                     const StoredFlightEvent& event, UtcMillis now, std::span<const int> basis = {});
  // A person says that it is wrong: the segment floats again, for ever. Segments that were placed by it float again as
  // well, until they are placed in another way. False: it is not merged.
  bool take_back_merge(int segment, std::string_view by, UtcMillis now);
  bool merge_taken_back(const FlightSegment& segment) const;
  std::vector<EstimateRecord> placed_estimates() const;  // of merged segments, by frame
  std::optional<EstimateRecord> placed_estimate(std::size_t frame) const;

  // ---- Reading

  // By frame, from the first one that is asked for.
  std::vector<Estimate> estimates(EstimateKind kind, std::size_t first = 0, std::size_t most = SIZE_MAX) const;
  std::optional<AdjustedPose> adjusted_pose(std::size_t frame) const;
  std::optional<Eigen::MatrixXd> adjusted_joint_covariance(const std::vector<std::size_t>& frames) const;
  std::optional<AdjustedLens> adjusted_lens() const;
  std::vector<FlightSegment> segments() const;
  std::vector<UserFix> fixes() const;  // by number, withdrawn ones too
  std::vector<MarkedObject> objects() const;
  std::optional<MarkedObject> object(std::int64_t id) const;
  std::int64_t last_event() const;  // its number
  // At most `most` events after the one of this number; 0: from the first.
  std::vector<EventRow> events_after(std::int64_t id, std::size_t most) const;
  std::vector<EventRow> events_of(FlightEventKind kind) const;  // all of them

 private:
  struct Impl;
  explicit FlightStore(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace nadir
