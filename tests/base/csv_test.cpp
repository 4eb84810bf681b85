#include "base/csv.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "base/error.hpp"
#include "support/temporary_folder.hpp"

namespace nadir {
namespace {

class Csv : public ::testing::Test {
 protected:
  CsvTable read(std::string_view text) { return CsvTable::read(folder_.write("t.csv", text)); }
  std::string complaint(std::string_view text) {
    try {
      read(text);
    } catch (const Error& error) {
      return error.what();
    }
    return "";
  }

  test::TemporaryFolder folder_;
};

TEST_F(Csv, ReadsRowsByColumnName) {
  const CsvTable table = read("frame,agl_m\na.jpg,119.5\nb.jpg,\n");
  ASSERT_EQ(table.rows(), 2U);
  EXPECT_EQ(table.cell(1, table.required_column("frame")), "b.jpg");
  EXPECT_EQ(table.number(0, table.required_column("agl_m")), 119.5);
  EXPECT_EQ(table.number(1, table.required_column("agl_m")), std::nullopt);
  EXPECT_EQ(table.column("heading_deg"), std::nullopt);
}

TEST_F(Csv, ParsesQuotesAndWindowsLineEndings) {
  const CsvTable table = read("a,b\r\n\"x,\"\"y\"\"\",2\r\n");
  ASSERT_EQ(table.rows(), 1U);
  EXPECT_EQ(table.cell(0, 0), "x,\"y\"");
}

TEST_F(Csv, RejectsInvalidNumbers) {
  for (const char* bad : {"nan", "NaN", "inf", "-inf", "1.5x", "abc", "1,5", "0x10"}) {
    const CsvTable table = read(std::string("a,b\n\"") + bad + "\",1\n");
    EXPECT_THROW(table.number(0, 0), Error) << bad;
  }
}

TEST_F(Csv, ErrorsNameFileLineAndCell) {
  const CsvTable table = read("frame,agl_m\na,1\nb,oops\n");
  try {
    table.number(1, 1);
    FAIL() << "accepted";
  } catch (const Error& error) {
    EXPECT_THAT(error.what(), ::testing::HasSubstr("t.csv:3"));
    EXPECT_THAT(error.what(), ::testing::HasSubstr("oops"));
    EXPECT_THAT(error.what(), ::testing::HasSubstr("agl_m"));
  }
}

TEST_F(Csv, TheLastRowHasItsOwnLineWithoutALineBreak) {
  const CsvTable table = read("frame,agl_m\na,1\nb,oops");
  EXPECT_EQ(table.line_of(1), 3U);
  EXPECT_THAT(table.where(1, 1), ::testing::EndsWith("t.csv:3, column agl_m"));
  EXPECT_EQ(read("a\n1\n").line_of(0), 2U);
}

TEST_F(Csv, RejectsARowWithAnotherNumberOfCells) {
  EXPECT_THAT(complaint("a,b\n1,2\n3\n"), ::testing::HasSubstr("t.csv:3"));
  EXPECT_NE(complaint("a,b\n1,2,3\n"), "");
}

TEST_F(Csv, RejectsOtherFiles) {
  EXPECT_NE(complaint(""), "");
  EXPECT_NE(complaint(std::string_view("a,b\n\0\0,1\n", 9)), "");
  EXPECT_THROW(CsvTable::read(folder_ / "missing.csv"), Error);
  EXPECT_THROW(CsvTable::read(folder_.path()), Error);
}

TEST_F(Csv, NamesTheMissingColumn) {
  const CsvTable table = read("a,b\n1,2\n");
  try {
    table.required_column("frame");
    FAIL() << "accepted";
  } catch (const Error& error) {
    EXPECT_THAT(error.what(), ::testing::HasSubstr("frame"));
  }
}

TEST(CsvCell, IsInQuotesWhereItNeedsThem) {
  EXPECT_EQ(csv_cell("a.jpg"), "a.jpg");
  EXPECT_EQ(csv_cell(""), "");
  EXPECT_EQ(csv_cell("-1.5"), "-1.5");
  EXPECT_EQ(csv_cell("a,b"), "\"a,b\"");
  EXPECT_EQ(csv_cell("12\" lens"), "\"12\"\" lens\"");
  EXPECT_EQ(csv_cell("a\nb"), "\"a\nb\"");
}

TEST(CsvCell, OfOthersTextIsNoFormulaToASpreadsheet) {
  EXPECT_EQ(spreadsheet_cell("a \"b\", c"), "\"a \"\"b\"\", c\"");
  EXPECT_EQ(spreadsheet_cell(""), "\"\"");
  for (const std::string start : {"=", "+", "-", "@", "\t", "\r"}) {
    EXPECT_EQ(spreadsheet_cell(start + "1"), "\"'" + start + "1\"");
    EXPECT_EQ(spreadsheet_cell("1" + start), "\"1" + start + "\"");
  }
}

}  // namespace
}  // namespace nadir
