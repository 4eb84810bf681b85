// usage: record_circle FOLDER: records the flight of recorded_circle.hpp there.
#include "flight/recorded_circle.hpp"

int main(int argc, char** argv) {
  if (argc != 2) return 2;
  nadir::test::RecordedCircle().record(argv[1]);
}
