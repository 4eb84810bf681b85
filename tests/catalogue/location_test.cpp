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

TEST(CatalogueLocation, MessagesHideThePassword) {
  const auto shown = [](const char* text) { return parse_catalogue_location(text).shown; };
  EXPECT_EQ(shown("PG:dbname=a password=secret host=h"), "PG:dbname=a password=*** host=h");
  EXPECT_EQ(shown("PG:password = 'se cr\\'et' dbname=a"), "PG:password = *** dbname=a");
  EXPECT_EQ(shown("PG:dbname=a PASSWORD=secret"), "PG:dbname=a PASSWORD=***");
  EXPECT_EQ(shown("PG:sslpassword=one password=two"), "PG:sslpassword=*** password=***");
  EXPECT_EQ(shown("postgresql://u:sec@ret@h/a?x=1"), "postgresql://u:***@h/a?x=1");
  EXPECT_EQ(shown("postgresql://h/a?password=secret&x=1"), "postgresql://h/a?password=***&x=1");
  EXPECT_EQ(shown("PG:dbname=a password="), "PG:dbname=a password=***");
  EXPECT_EQ(shown("PG:dbname=password"), "PG:dbname=password");
  const CatalogueLocation location = parse_catalogue_location("PG:dbname=a password=secret");
  EXPECT_EQ(location.name, "PG:dbname=a password=secret") << "what is opened keeps it";
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
