#include "model/basis_format.hpp"

#include <algorithm>
#include <charconv>
#include <map>
#include <string_view>

#include "model/error.hpp"
#include "model/hash.hpp"
#include "model/mapping.hpp"

namespace brdfgate {
namespace {

// As PNG's: a high byte and both line ends, so that a text-mode transfer is noticed.
constexpr std::string_view kMagic(
    "\x89"
    "BRDF\r\n\x1a",
    8);
constexpr std::size_t kAlignment = 64;
constexpr std::size_t kMaxHeader = std::size_t{1} << 20;
constexpr int kMaxAxis = 1024;
constexpr std::size_t kMaxCells = std::size_t{1} << 26;
constexpr int kMaxComponents = 4096;
constexpr int kMaxObservations = 1 << 20;

std::size_t aligned(std::size_t offset) {
  return (offset + kAlignment - 1) / kAlignment * kAlignment;
}

std::string line(const std::string& field, const std::string& value) {
  if (std::any_of(value.begin(), value.end(), [](unsigned char c) { return c < 32; })) {
    throw InputError("basis", "field '" + field + "' holds a control character",
                     "one line of text");
  }
  return field + ": " + value + "\n";
}

/// Shortest text that reads back as the same number.
std::string number(double value) {
  std::array<char, 32> text{};
  const auto end = std::to_chars(text.data(), text.data() + text.size(), value).ptr;
  return {text.data(), end};
}

/// Header lines by field, refusing what is there twice and counting off what was asked for.
class Fields {
 public:
  Fields(const std::filesystem::path& file, std::string_view text) : file_(file) {
    while (!text.empty()) {
      const std::size_t end = std::min(text.find('\n'), text.size());
      add(text.substr(0, end));
      text.remove_prefix(std::min(end + 1, text.size()));
    }
  }

  std::string text(const std::string& field) {
    const auto found = values_.find(field);
    if (found == values_.end()) refuse_basis_field(file_, field, "is missing");
    std::string value = std::move(found->second);
    values_.erase(found);
    return value;
  }

  template <typename Number>
  Number number(const std::string& field, Number least, Number most) {
    const std::string value = text(field);
    return parse(field, value, least, most);
  }

  BasisGrid grid() {
    const std::string value = text("grid");
    const std::size_t first = value.find(' ');
    const std::size_t second = value.find(' ', std::min(first, value.size() - 1) + 1);
    if (first == std::string::npos || second == std::string::npos) {
      refuse_basis_field(file_, "grid", "is '" + value + "'", "three numbers of cells");
    }
    const std::string_view v(value);
    return {parse("grid", v.substr(0, first), 2, kMaxAxis),
            parse("grid", v.substr(first + 1, second - first - 1), 2, kMaxAxis),
            parse("grid", v.substr(second + 1), 2, kMaxAxis)};
  }

  void refuse_rest() const {
    if (!values_.empty()) refuse_basis_field(file_, values_.begin()->first, "is not known");
  }

 private:
  void add(std::string_view line) {
    const std::size_t colon = line.find(": ");
    if (colon == std::string_view::npos) {
      refuse_basis_field(file_, std::string(line.substr(0, 40)), "has no value", "field: value");
    }
    const std::string field(line.substr(0, colon));
    if (!values_.emplace(field, line.substr(colon + 2)).second) {
      refuse_basis_field(file_, field, "is there twice");
    }
  }

  template <typename Number>
  Number parse(const std::string& field, std::string_view value, Number least, Number most) const {
    Number n{};
    const auto [end, error] = std::from_chars(value.data(), value.data() + value.size(), n);
    if (error != std::errc() || end != value.data() + value.size() || !(n >= least && n <= most)) {
      refuse_basis_field(file_, field, "is '" + std::string(value) + "'",
                         "a number from " + std::to_string(least) + " to " + std::to_string(most));
    }
    return n;
  }

  std::filesystem::path file_;
  std::map<std::string, std::string> values_;
};

/// The header's lines without its last, "header_checksum", which is over the others.
std::string_view checked_lines(const std::filesystem::path& file, std::string_view text) {
  constexpr std::string_view kLast = "header_checksum: ";
  const std::size_t start = text.rfind(kLast);
  if (start == std::string_view::npos || (start > 0 && text[start - 1] != '\n')) {
    refuse_basis_field(file, "header_checksum", "is missing");
  }
  const std::string_view lines = text.substr(0, start);
  const std::string computed = sha256_hex(std::string(lines));
  if (text.substr(start + kLast.size()) != computed) {
    refuse_basis_field(file, "header_checksum",
                       "is not that of the header: the header was changed or is damaged", computed);
  }
  return lines;
}

BasisInfo read_info(const std::filesystem::path& file, Fields& fields) {
  BasisInfo info;
  info.version = fields.number("version", 0, 1 << 30);
  if (info.version != kBasisVersion) {
    refuse_basis_field(file, "version", "is " + std::to_string(info.version),
                       std::to_string(kBasisVersion));
  }
  info.grid = fields.grid();
  if (info.grid.cells() > kMaxCells) {
    refuse_basis_field(file, "grid", "has " + std::to_string(info.grid.cells()) + " cells",
                       "at most " + std::to_string(kMaxCells));
  }
  info.valid_cells = fields.number("valid_cells", std::size_t{1}, info.grid.cells());
  info.observations = fields.number("observations", 2, kMaxObservations);
  info.components = fields.number("components", 1, std::min(kMaxComponents, info.observations - 1));
  info.exemplars = fields.number("exemplars", 0, kMaxObservations);
  info.epsilon = fields.number("epsilon", 0.0, 1.0);
  if (info.epsilon != kMappingEpsilon) {
    refuse_basis_field(file, "epsilon", "is " + number(info.epsilon), number(kMappingEpsilon));
  }
  info.training_set = fields.text("training_set");
  info.training_hash = fields.text("training_hash");
  info.licence = fields.text("licence");
  info.attribution = fields.text("attribution");
  info.checksum = fields.text("checksum");
  fields.refuse_rest();
  return info;
}

}  // namespace

void refuse_basis_field(const std::filesystem::path& file, const std::string& field,
                        const std::string& what, const std::string& expected) {
  throw InputError("basis " + file.string(), "field '" + field + "' " + what, expected);
}

BasisLayout basis_layout(const BasisInfo& info) {
  const auto k = static_cast<std::size_t>(info.components);
  BasisLayout at{};
  at.singular_values = 0;
  at.validity = aligned(k * sizeof(double));
  at.mean = aligned(at.validity + info.grid.cells());
  at.median = aligned(at.mean + info.valid_cells * sizeof(float));
  at.components = aligned(at.median + info.valid_cells * sizeof(float));
  at.training_weights = aligned(at.components + info.valid_cells * k * sizeof(std::uint16_t));
  const auto observations = static_cast<std::size_t>(info.observations);
  const auto exemplars = static_cast<std::size_t>(info.exemplars);
  at.exemplars = aligned(at.training_weights + observations * k * sizeof(float));
  at.exemplar_weights = aligned(at.exemplars + exemplars * sizeof(ExemplarRecord));
  at.size = aligned(at.exemplar_weights + exemplars * k * sizeof(float));
  return at;
}

std::string encode_basis_header(const BasisInfo& info) {
  const BasisGrid& g = info.grid;
  std::string lines = line("version", std::to_string(kBasisVersion)) +
                      line("grid", std::to_string(g.theta_h) + " " + std::to_string(g.theta_d) +
                                       " " + std::to_string(g.phi_d)) +
                      line("valid_cells", std::to_string(info.valid_cells)) +
                      line("components", std::to_string(info.components)) +
                      line("observations", std::to_string(info.observations)) +
                      line("exemplars", std::to_string(info.exemplars)) +
                      line("epsilon", number(kMappingEpsilon)) +
                      line("training_set", info.training_set) +
                      line("training_hash", info.training_hash) + line("licence", info.licence) +
                      line("attribution", info.attribution) + line("checksum", info.checksum);
  std::string header(kMagic);
  header += lines + line("header_checksum", sha256_hex(lines)) + "\n";
  if (header.size() > kMaxHeader) {
    throw InputError("basis", "header of " + std::to_string(header.size()) + " bytes",
                     "at most " + std::to_string(kMaxHeader));
  }
  header.resize(aligned(header.size()), '\0');
  return header;
}

BasisHeader decode_basis_header(const std::filesystem::path& file,
                                std::span<const std::byte> bytes) {
  const std::string_view all(reinterpret_cast<const char*>(bytes.data()),
                             std::min(bytes.size(), kMaxHeader));
  if (!all.starts_with(kMagic)) {
    refuse_basis_field(file, "magic", "is not that of a basis file", "a file from 'basis build'");
  }
  const std::size_t end = all.find("\n\n", kMagic.size());
  if (end == std::string_view::npos) {
    refuse_basis_field(file, "header", "has no end: truncated or damaged");
  }
  const std::string_view text = all.substr(kMagic.size(), end - kMagic.size());
  Fields fields(file, checked_lines(file, text));
  BasisHeader header{read_info(file, fields), aligned(end + 2)};
  const std::size_t size = header.payload_start + basis_layout(header.info).size;
  if (bytes.size() != size) {
    refuse_basis_field(file, "size", "is " + std::to_string(bytes.size()) + " bytes",
                       std::to_string(size) + " for its grid and components");
  }
  return header;
}

}  // namespace brdfgate
