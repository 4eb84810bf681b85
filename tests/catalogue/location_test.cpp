#include "catalogue/location.hpp"

#include <gtest/gtest.h>

#include "base/error.hpp"
#include "catalogue/database.hpp"

namespace nadir {
namespace {

using Kind = CatalogueLocation::Kind;

TEST(CatalogueLocation, FilesAndDatabases) {
  EXPECT_EQ(parse_catalogue_location("fleet.sqlite").kind, Kind::file);
  EXPECT_EQ(parse_catalogue_location("./PG:odd").kind, Kind::file);
  EXPECT_EQ(parse_catalogue_location("PG:dbname=fleet").kind, Kind::postgres);
  EXPECT_EQ(parse_catalogue_location("postgresql://db/fleet").kind, Kind::postgres);
  for (const char* text : {"", "/vsicurl/http://x/y", "/VSIMEM/x"}) {
    EXPECT_THROW(parse_catalogue_location(text), UsageError) << text;
  }
}

// Every user of the computer can read command lines; and the message must not repeat the password.
TEST(CatalogueLocation, APasswordIsRejectedAndNotShown) {
  const auto shown = [](const char* text) {
    try {
      parse_catalogue_location(text);
      return std::string("accepted");
    } catch (const UsageError& error) {
      EXPECT_EQ(std::string_view(error.what()).find("secret"), std::string_view::npos) << error.what();
      EXPECT_NE(error.text().fix.find(".pgpass"), std::string::npos);
      return error.text().where;
    }
  };
  EXPECT_EQ(shown("PG:dbname=a password=secret host=h"), "PG:dbname=a password=*** host=h");
  EXPECT_EQ(shown("PG:password = 'se cr\\'et' dbname=a"), "PG:password = *** dbname=a");
  EXPECT_EQ(shown("PG:dbname=a PASSWORD=secret"), "PG:dbname=a PASSWORD=***");
  EXPECT_EQ(shown("PG:sslpassword=one password=two"), "PG:sslpassword=*** password=***");
  EXPECT_EQ(shown("postgresql://u:sec@ret@h/a?x=1"), "postgresql://u:***@h/a?x=1");
  EXPECT_EQ(shown("postgresql://h/a?password=secret&x=1"), "postgresql://h/a?password=***&x=1");
  EXPECT_EQ(shown("PG:dbname=a password="), "PG:dbname=a password=***");
  EXPECT_EQ(shown("PG:dbname=password"), "accepted");
  EXPECT_EQ(shown("postgresql://u@h/a"), "accepted");
}

TEST(DatabaseErrors, GiveMatchingAdvice) {
  EXPECT_NE(advice_for_database_message("FATAL:  password authentication failed for user \"x\"").find("PGPASSWORD"),
            std::string::npos);
  EXPECT_NE(advice_for_database_message("database is locked").find("another process"), std::string::npos);
  EXPECT_FALSE(advice_for_database_message("something new").empty());
  EXPECT_FALSE(advice_for_database_message("").empty());
}

}  // namespace
}  // namespace nadir
