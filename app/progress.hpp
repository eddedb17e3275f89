// A progress bar on stderr, on a terminal only.
#pragma once

#include <unistd.h>

#include <cstdio>
#include <string>
#include <utility>

namespace brdfgate {

/// Redraws one line while work goes on and clears it at the end. Silent where stderr is not a
/// terminal.
class Progress {
 public:
  Progress(std::string label, int steps)
      : label_(std::move(label)), steps_(steps), visible_(isatty(STDERR_FILENO) == 1) {
    update(0);
  }
  Progress(const Progress&) = delete;
  Progress& operator=(const Progress&) = delete;
  ~Progress() {
    if (visible_) std::fputs("\r\033[K", stderr);
  }

  /// One more of the steps is done.
  void advance() { update(steps_ > 0 ? double(++done_) / steps_ : 1.0); }

  /// @param share  done, 0..1
  void update(double share) {
    if (!visible_) return;
    constexpr int kWidth = 30;
    const int filled = static_cast<int>(share * kWidth);
    std::string bar(static_cast<std::size_t>(filled), '#');
    bar.resize(kWidth, '.');
    std::fprintf(stderr, "\r%s [%s] %3.0f %%", label_.c_str(), bar.c_str(), 100 * share);
    std::fflush(stderr);
  }

 private:
  std::string label_;
  int steps_;
  int done_ = 0;
  bool visible_;
};

}  // namespace brdfgate
