// The loop of a server's thread.
#pragma once

#include <boost/asio/io_context.hpp>
#include <exception>

namespace nadir {

// Until there is nothing more to do. What a handler throws (there is no memory, above all) ends what it was doing; it
// ends neither other connections nor the program, which may have a flight to fly.
inline void serve_until_done(boost::asio::io_context& io) {
  for (;;) {
    try {
      io.run();
      return;
    } catch (const std::exception&) {
    }
  }
}

}  // namespace nadir
