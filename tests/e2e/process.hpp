#pragma once

#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <cstdio>
#include <filesystem>
#include <stdexcept>
#include <string>
#include <vector>

namespace cellmap::test {

/// What a program that ended left behind.
struct Ended {
  int exit_code = -1;  ///< 128 + signal where a signal ended it
  std::string out;
};

/// A child process whose standard output is read through a pipe; standard error is appended to a
/// file. Killed when destroyed.
class Process {
 public:
  Process(std::vector<std::string> command, const std::filesystem::path& error_file) {
    int ends[2];
    if (::pipe(ends) != 0) throw std::runtime_error("pipe failed");
    pid_ = ::fork();
    if (pid_ == 0) {
      ::dup2(ends[1], STDOUT_FILENO);
      ::close(ends[0]);
      ::close(ends[1]);
      if (std::freopen(error_file.c_str(), "a", stderr) == nullptr) ::_exit(126);
      std::vector<char*> argv;
      for (std::string& argument : command) argv.push_back(argument.data());
      argv.push_back(nullptr);
      ::execvp(argv[0], argv.data());
      ::_exit(127);
    }
    ::close(ends[1]);
    out_ = ::fdopen(ends[0], "r");
  }
  ~Process() {
    if (pid_ > 0) signal_and_wait(SIGKILL);
    if (out_ != nullptr) std::fclose(out_);
  }
  Process(const Process&) = delete;
  Process& operator=(const Process&) = delete;

  pid_t pid() const { return pid_; }

  /// The next line of standard output; "" at its end.
  std::string read_line() {
    std::string line;
    for (int c = std::fgetc(out_); c != EOF; c = std::fgetc(out_)) {
      line += static_cast<char>(c);
      if (c == '\n') break;
    }
    return line;
  }

  /// Reads the rest of its output and waits for its end.
  Ended wait() {
    Ended ended;
    while (true) {
      const std::string line = read_line();
      if (line.empty()) break;
      ended.out += line;
    }
    ended.exit_code = reap();
    return ended;
  }

  int signal_and_wait(int signal) {
    ::kill(pid_, signal);
    return reap();
  }

 private:
  int reap() {
    int status = 0;
    ::waitpid(pid_, &status, 0);
    pid_ = -1;
    return WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
  }

  pid_t pid_ = -1;
  FILE* out_ = nullptr;
};

}  // namespace cellmap::test
