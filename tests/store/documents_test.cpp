#include "cellmap/store/documents.hpp"

#include <gtest/gtest.h>

#include "cellmap/store/sqlite_connection.hpp"
#include "cellmap/store/sqlite_store.hpp"
#include "store/older_schema.hpp"
#include "support/expect_error.hpp"
#include "support/temp_folder.hpp"

namespace cellmap {
namespace {

class DocumentsTest : public ::testing::Test {
 protected:
  DocumentsTest() { store_->create_map("town", {}); }
  Documents& documents() { return documents_of(*store_); }

  test::TempFolder folder_;
  std::filesystem::path file_ = folder_.path() / "store.db";
  std::unique_ptr<Store> store_ = open_sqlite_store(file_);
};

TEST_F(DocumentsTest, AreReplacedAsAWholeAndSurviveTheProcess) {
  EXPECT_FALSE(documents().document("town", "comparison"));
  documents().put_document("town", "comparison", "one");
  documents().put_document("town", "comparison", "two");
  documents().put_document("town", "other", "three");
  store_.reset();
  store_ = open_sqlite_store(file_);
  EXPECT_EQ(documents().document("town", "comparison"), "two");
  EXPECT_EQ(documents().document("town", "other"), "three");
}

TEST_F(DocumentsTest, OneThatWasRemovedIsGoneAndTheOthersStay) {
  documents().put_document("town", "comparison", "one");
  documents().put_document("town", "other", "two");
  documents().remove_document("town", "comparison");
  documents().remove_document("town", "comparison");
  EXPECT_FALSE(documents().document("town", "comparison"));
  EXPECT_EQ(documents().document("town", "other"), "two");
}

TEST_F(DocumentsTest, GoWithTheirMap) {
  documents().put_document("town", "comparison", "one");
  store_->delete_map("town");
  test::expect_error(ErrorCode::kNotFound, [&] { documents().document("town", "comparison"); });
  store_->create_map("town", {});
  EXPECT_FALSE(documents().document("town", "comparison"));
}

TEST_F(DocumentsTest, NeedAMapAndHaveALimit) {
  test::expect_error(ErrorCode::kNotFound,
                     [&] { documents().put_document("none", "comparison", "one"); });
  test::expect_error(ErrorCode::kTooLarge, [&] {
    documents().put_document("town", "comparison", std::string(Documents::kMaxBytes + 1, 'x'));
  });
}

TEST_F(DocumentsTest, ChangeNoRevision) {
  documents().put_document("town", "comparison", "one");
  EXPECT_EQ(store_->map("town").revision, 0u);
}

TEST_F(DocumentsTest, CanBeKeptByAStoreThatWasMadeBeforeThem) {
  store_.reset();
  {
    SqliteConnection connection(file_, SqliteAccess::kReadWrite, 1000);
    connection.execute(test::kUndoSchema9);
    connection.execute(test::kUndoSchema8);
    connection.execute(test::kUndoSchema7);
    connection.execute(test::kUndoSchema6);
    connection.execute(test::kUndoSchema5);
    connection.execute("DROP TABLE document; PRAGMA user_version = 3");
  }
  store_ = open_sqlite_store(file_);
  documents().put_document("town", "comparison", "one");
  EXPECT_EQ(documents().document("town", "comparison"), "one");
}

}  // namespace
}  // namespace cellmap
