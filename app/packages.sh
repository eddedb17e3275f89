# Debian packages of the project, by what needs them. Sourced by app/demo.sh and tests/run.sh.
# shellcheck shell=bash disable=SC2034
BUILD_PACKAGES=(build-essential cmake ninja-build ccache pkg-config
  libopencv-dev libeigen3-dev libceres-dev libopenexr-dev libmodbus-dev libgpiod-dev libcamera-dev libsystemd-dev libyaml-cpp-dev libcli11-dev
  libspdlog-dev nlohmann-json3-dev libssl-dev catch2
  gnuplot-nox)  # drawn with, not linked to: --picture
TEST_PACKAGES=(python3 python3-pymodbus python3-serial-asyncio python3-numpy mbpoll socat)
# The kernel lab (tests/kernel/run.sh): a guest and the modules it tests with.
KERNEL_LAB_PACKAGES=(mmdebstrap debian-archive-keyring qemu-system-x86 qemu-utils busybox-static cpio xz-utils e2fsprogs kmod
  linux-headers-amd64 binutils)
LINT_PACKAGES=(clang-format-19 clang-tidy-19)
