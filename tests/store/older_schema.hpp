#pragma once

namespace cellmap::test {

/// SQL that takes back what a version of the schema added, the newest first, for tests that make an
/// older store.
inline constexpr const char* kUndoSchema9 = "ALTER TABLE blob DROP COLUMN frame_bytes;";
inline constexpr const char* kUndoSchema8 = "DROP TABLE cell_description;";
inline constexpr const char* kUndoSchema7 = "DROP TABLE job_part;";
inline constexpr const char* kUndoSchema6 = R"sql(
    DROP INDEX job_unfinished;
    ALTER TABLE job DROP COLUMN alone;
    ALTER TABLE job DROP COLUMN worker;
    ALTER TABLE job DROP COLUMN claim;
    ALTER TABLE job DROP COLUMN lease_ends;
    ALTER TABLE job DROP COLUMN cancel_asked;
    )sql";
inline constexpr const char* kUndoSchema5 = R"sql(
    ALTER TABLE map DROP COLUMN encoding;
    ALTER TABLE map DROP COLUMN bound_um;
    ALTER TABLE cell DROP COLUMN encoding;
    ALTER TABLE cell DROP COLUMN bound_um;
    ALTER TABLE cell DROP COLUMN identity;
    ALTER TABLE cell DROP COLUMN source;
    ALTER TABLE cell DROP COLUMN replaced;
    )sql";

}  // namespace cellmap::test
