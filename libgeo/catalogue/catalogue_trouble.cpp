#include "catalogue/catalogue_trouble.hpp"

#include <array>

namespace nadir {
namespace {

struct Advice {
  std::string_view sign;
  std::string_view fix;
};

constexpr std::array kAdvice{
    Advice{"password",
           "give the right password: in PGPASSWORD, in ~/.pgpass, or as password=… in the connection string"},
    Advice{"no pg_hba.conf entry", "the server does not let this user in from here: ask its administrator"},
    Advice{"server closed the connection",
           "the server went away and nothing was written; run the command again when it is back"},
    Advice{"terminating connection",
           "the server went away and nothing was written; run the command again when it is back"},
    Advice{"no connection to the server",
           "the server went away and nothing was written; run the command again when it is back"},
    Advice{"Is the server running", "start the server, or correct host and port in the connection string"},
    Advice{"could not translate host name", "correct the host in the connection string"},
    Advice{"Connection refused", "start the server, or correct host and port in the connection string"},
    Advice{"the database system is", "the server is starting or stopping; run the command again in a moment"},
    Advice{"permission denied",
           "ask for the rights: USAGE on the schema nadir, and on its tables SELECT to read, also INSERT, UPDATE and "
           "DELETE to write"},
    Advice{"Permission denied",
           "ask for the rights to write to the file and to its folder, or copy it to where you have them"},
    Advice{"read-only transaction", "the database is read-only: name one that can be written, not a replica"},
    Advice{"readonly database", "the file is read-only: copy it to where you may write"},
    Advice{"lock timeout", "another process is writing into this catalogue; run the command again when it is done"},
    Advice{"database is locked",
           "another process is writing into this catalogue; run the command again when it is done"},
    Advice{"deadlock", "another process is writing into this catalogue; run the command again when it is done"},
    Advice{"disk is full", "free space on the disk, and run the command again; nothing was written"},
    Advice{"No space left", "free space on the disk, and run the command again; nothing was written"},
    Advice{"role \"", "correct the user in the connection string, or let an administrator create it: createuser NAME"},
    Advice{"does not exist", "make the database: createdb NAME, then psql -d NAME -c 'CREATE EXTENSION postgis'"},
    Advice{"malformed",
           "the file is damaged: restore it from a copy, or make a new catalogue and add the packages again"},
    Advice{"not a database", "name a catalogue that `nadir catalogue add` made"},
};

}  // namespace

std::string advice_for_database_message(std::string_view message) {
  for (const Advice& advice : kAdvice) {
    if (message.find(advice.sign) != std::string_view::npos) return std::string(advice.fix);
  }
  return "see what `ogrinfo -so` says about the same place";
}

}  // namespace nadir
