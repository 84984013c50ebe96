#pragma once

#include <sqlite3.h>

#include <atomic>
#include <cstddef>
#include <new>
#include <stdexcept>

namespace cellmap::test {

/// What a disk does wrong.
enum class Fault {
  kFull,       ///< nothing more can be written, until there is room again
  kFullOnce,   ///< one write finds no room, the next one does
  kBrokenOnce  ///< one operation fails, of whichever kind
};

/// A disk below SQLite that fails when it is told to. While one lives, it is SQLite's default:
/// databases that are opened meanwhile lie on it, and must be closed before it goes. Counts what
/// may fail: opening, writing, syncing, truncating and deleting files, and growing shared memory.
/// Several threads may use it.
class FaultyDisk {
 public:
  FaultyDisk() : real_(sqlite3_vfs_find(nullptr)), vfs_(*real_) {
    vfs_.zName = "faulty";
    vfs_.pAppData = this;
    vfs_.szOsFile = static_cast<int>(kOwnBytes) + real_->szOsFile;
    vfs_.xOpen = open;
    vfs_.xDelete = remove;
    // The rest asks the real one, which looks into its own structure.
    vfs_.xAccess = [](sqlite3_vfs* vfs, const char* name, int flags, int* out) {
      return real_of(vfs).xAccess(&real_of(vfs), name, flags, out);
    };
    vfs_.xFullPathname = [](sqlite3_vfs* vfs, const char* name, int size, char* out) {
      return real_of(vfs).xFullPathname(&real_of(vfs), name, size, out);
    };
    if (sqlite3_vfs_register(&vfs_, 1) != SQLITE_OK) throw std::runtime_error("no VFS");
  }
  ~FaultyDisk() {
    sqlite3_vfs_unregister(&vfs_);
    sqlite3_vfs_register(real_, 1);
  }
  FaultyDisk(const FaultyDisk&) = delete;
  FaultyDisk& operator=(const FaultyDisk&) = delete;

  /// The `n`-th operation from now (the first is 1) that can fail so fails.
  void fail_at(int n, Fault fault) {
    fault_ = fault;
    happened_ = false;
    left_ = n;
  }
  void heal() { left_ = 0; }
  /// Whether it has failed since `fail_at`.
  bool has_failed() const { return happened_; }

 private:
  /// What SQLite holds of an open file; the real one's follows it.
  struct File {
    sqlite3_file base;
    FaultyDisk* disk;
    sqlite3_io_methods methods;
  };
  static constexpr std::size_t kOwnBytes = (sizeof(File) + 15) / 16 * 16;

  static FaultyDisk& disk_of(sqlite3_vfs* vfs) { return *static_cast<FaultyDisk*>(vfs->pAppData); }
  static sqlite3_vfs& real_of(sqlite3_vfs* vfs) { return *disk_of(vfs).real_; }
  static FaultyDisk& disk_of(sqlite3_file* file) { return *reinterpret_cast<File*>(file)->disk; }
  static sqlite3_file* real_of(sqlite3_file* file) {
    return reinterpret_cast<sqlite3_file*>(reinterpret_cast<std::byte*>(file) + kOwnBytes);
  }

  /// `grows`: it needs room, so that a full disk fails it.
  bool fails(bool grows) {
    if (left_ <= 0 || (!grows && fault_ != Fault::kBrokenOnce)) return false;
    if (left_ > 1) {
      --left_;
      return false;
    }
    happened_ = true;
    if (fault_ != Fault::kFull) left_ = 0;
    return true;
  }
  int full_or(int broken) const { return fault_ == Fault::kBrokenOnce ? broken : SQLITE_FULL; }

  static int open(sqlite3_vfs* vfs, sqlite3_filename name, sqlite3_file* file, int flags,
                  int* out_flags) {
    FaultyDisk& disk = disk_of(vfs);
    file->pMethods = nullptr;
    if (disk.fails(false)) return SQLITE_CANTOPEN;
    sqlite3_file* const real = real_of(file);
    real->pMethods = nullptr;
    const int result = disk.real_->xOpen(disk.real_, name, real, flags, out_flags);
    if (!real->pMethods) return result;
    File* const own = new (file) File{{nullptr}, &disk, methods_for(*real->pMethods)};
    file->pMethods = &own->methods;
    return result;
  }

  static int remove(sqlite3_vfs* vfs, const char* name, int sync) {
    if (disk_of(vfs).fails(false)) return SQLITE_IOERR_DELETE;
    return real_of(vfs).xDelete(&real_of(vfs), name, sync);
  }

  static int write(sqlite3_file* file, const void* data, int size, sqlite3_int64 offset) {
    FaultyDisk& disk = disk_of(file);
    if (disk.fails(true)) return disk.full_or(SQLITE_IOERR_WRITE);
    return real_of(file)->pMethods->xWrite(real_of(file), data, size, offset);
  }
  static int truncate(sqlite3_file* file, sqlite3_int64 size) {
    if (disk_of(file).fails(false)) return SQLITE_IOERR_TRUNCATE;
    return real_of(file)->pMethods->xTruncate(real_of(file), size);
  }
  static int sync(sqlite3_file* file, int flags) {
    if (disk_of(file).fails(false)) return SQLITE_IOERR_FSYNC;
    static_cast<void>(flags);
    return SQLITE_OK;  // no test takes the power away, and waiting for the disk is what costs time
  }
  static int shm_map(sqlite3_file* file, int page, int size, int extend, void volatile** out) {
    // SQLite's own VFS says this of a full disk too.
    if (extend && disk_of(file).fails(true)) return SQLITE_IOERR_SHMSIZE;
    return real_of(file)->pMethods->xShmMap(real_of(file), page, size, extend, out);
  }

  static sqlite3_io_methods methods_for(const sqlite3_io_methods& real) {
    sqlite3_io_methods m = real;
    m.iVersion = 2;  // no memory mapping
    m.xClose = [](sqlite3_file* f) { return real_of(f)->pMethods->xClose(real_of(f)); };
    m.xRead = [](sqlite3_file* f, void* data, int size, sqlite3_int64 offset) {
      return real_of(f)->pMethods->xRead(real_of(f), data, size, offset);
    };
    m.xWrite = write;
    m.xTruncate = truncate;
    m.xSync = sync;
    m.xFileSize = [](sqlite3_file* f, sqlite3_int64* size) {
      return real_of(f)->pMethods->xFileSize(real_of(f), size);
    };
    m.xLock = [](sqlite3_file* f, int lock) {
      return real_of(f)->pMethods->xLock(real_of(f), lock);
    };
    m.xUnlock = [](sqlite3_file* f, int lock) {
      return real_of(f)->pMethods->xUnlock(real_of(f), lock);
    };
    m.xCheckReservedLock = [](sqlite3_file* f, int* out) {
      return real_of(f)->pMethods->xCheckReservedLock(real_of(f), out);
    };
    m.xFileControl = [](sqlite3_file* f, int op, void* argument) {
      return real_of(f)->pMethods->xFileControl(real_of(f), op, argument);
    };
    m.xSectorSize = [](sqlite3_file* f) { return real_of(f)->pMethods->xSectorSize(real_of(f)); };
    m.xDeviceCharacteristics = [](sqlite3_file* f) {
      return real_of(f)->pMethods->xDeviceCharacteristics(real_of(f));
    };
    m.xShmMap = shm_map;
    m.xShmLock = [](sqlite3_file* f, int offset, int n, int flags) {
      return real_of(f)->pMethods->xShmLock(real_of(f), offset, n, flags);
    };
    m.xShmBarrier = [](sqlite3_file* f) { real_of(f)->pMethods->xShmBarrier(real_of(f)); };
    m.xShmUnmap = [](sqlite3_file* f, int remove_it) {
      return real_of(f)->pMethods->xShmUnmap(real_of(f), remove_it);
    };
    return m;
  }

  sqlite3_vfs* const real_;
  sqlite3_vfs vfs_;
  std::atomic<int> left_ = 0;
  std::atomic<bool> happened_ = false;
  std::atomic<Fault> fault_ = Fault::kFull;
};

}  // namespace cellmap::test
