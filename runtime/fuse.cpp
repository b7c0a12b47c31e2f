// The text of generated kernels. Arguments, which plan.cpp follows: a record of words, inputs (but those that an output
// replaces), outputs. The words: per input its offset, strides of the outer axes, and inner stride if it is neither 0
// nor 1; scalars; extents; then (pointwise) chunk, rows, stream or (reduction) kept, per_item, length.
#include "runtime/fuse.h"

#include <algorithm>
#include <cctype>
#include <cstring>
#include <sstream>

#include "runtime/hash.h"

namespace cloam {
namespace {

const char* c_type(DType dtype) {
  switch (dtype) {
    case DType::i32:
      return "int";
    case DType::u32:
      return "uint";
    case DType::u8:
      return "uchar";
    case DType::f16:
      return "half";
    default:
      return "float";
  }
}

/// The type a loaded or computed value has in registers.
const char* register_type(DType dtype) {
  return dtype == DType::f16 ? "float" : dtype == DType::u8 ? "int" : c_type(dtype);
}

struct Writer {
  const Group& group;
  const Layout& layout;
  std::ostringstream out = {};
  int words = 0;

  int rank() const { return layout.extents.rank(); }
  int inner() const { return rank() - 1; }

  /// The output that lies where input i does, or -1.
  int heir(size_t i) const {
    for (size_t j = 0; j < group.outputs.size(); j++)
      if ((layout.in_place >> j & 1u) && group.outputs[j].heir_of == static_cast<int>(i)) return static_cast<int>(j);
    return -1;
  }

  void word(const std::string& declared) { out << "  const " << declared << " = words.at[" << words++ << "];\n"; }

  void input_words(size_t i) {
    const std::string n = std::to_string(i);
    word("int o" + n);
    for (int axis = 0; axis < inner(); axis++) word("int s" + n + "_" + std::to_string(axis));
    if (layout.inner_kind(i) == 2) word("int s" + n + "_" + std::to_string(inner()));
  }

  /// The parameter list, and the words under their names.
  void begin(std::initializer_list<const char*> more_words) {
    const char* comma = "";
    const auto pointer = [&](const char* access, DType dtype, const char* name, size_t i) {
      out << comma << "__global " << access << c_type(dtype) << "* restrict " << name << i;
      comma = ", ";
    };
    for (size_t i = 0; i < group.inputs.size(); i++)
      if (heir(i) < 0) pointer("const ", group.inputs[i].dtype, "x", i);
    if (group.reduce) pointer("", group.reduce_dtype, "y", 0);
    for (size_t i = 0; i < group.outputs.size(); i++) pointer("", group.outputs[i].dtype, "y", i);
    out << ") {\n";
    for (size_t i = 0; i < group.inputs.size(); i++)
      if (heir(i) < 0) input_words(i);
    for (size_t i = 0; i < group.scalars.size(); i++) {
      const DType dtype = group.scalars[i].dtype;
      out << "  const " << register_type(dtype) << " c" << i << " = as_" << register_type(dtype) << "(words.at["
          << words++ << "]);\n";
    }
    for (int axis = 0; axis < rank(); axis++) word("int e" + std::to_string(axis));
    for (const char* name : more_words) word(std::string("int ") + name);
  }

  /// int i0, i1 ... of the axes in `axes` (innermost last) from the linear index `from`.
  void decompose(const std::vector<int>& axes, const std::string& from) {
    for (size_t n = axes.size(); n-- > 0;) {
      std::string rest = from;
      if (n + 1 < axes.size()) rest = "q" + std::to_string(axes[n + 1]);
      out << "    const int i" << axes[n] << " = " << (n == 0 ? rest : rest + " % e" + std::to_string(axes[n])) << ";";
      if (n > 0) out << " const int q" << axes[n] << " = " << rest << " / e" << axes[n] << ";";
      out << "\n";
    }
  }

  /// Index of input i: offset plus the outer axes in `axes`.
  std::string base(size_t i, const std::vector<int>& axes) {
    std::string text = "o" + std::to_string(i);
    for (int axis : axes)
      text += " + i" + std::to_string(axis) + " * s" + std::to_string(i) + "_" + std::to_string(axis);
    return text;
  }

  std::string load(size_t i, const std::string& index) {
    const int replaced_by = heir(i);
    const int kind = layout.inner_kind(i);
    std::string at = kind == 0 ? "0" : index;
    if (kind == 2) at = index + " * s" + std::to_string(i) + "_" + std::to_string(inner());
    const std::string p = replaced_by < 0 ? "p" + std::to_string(i) : "r" + std::to_string(replaced_by);
    return group.inputs[i].dtype == DType::f16 ? "vload_half(" + at + ", " + p + ")" : p + "[" + at + "]";
  }

  std::string operand(const Operand& o, Typing typing, DType result) {
    static const char* const prefix[] = {"v", "a", "c"};
    const std::string name = prefix[o.kind] + std::to_string(o.index);
    if (typing == Typing::floating || typing == Typing::same) return "(float)" + name;
    if (typing == Typing::promote && result == DType::f32) return "(float)" + name;
    return name;
  }

  std::string expression(const Instruction& step) {
    if (!step.op) return operand(step.operands[0], Typing::cast_to, step.dtype);
    std::string text;
    const std::string code = step.op->expression;
    for (size_t i = 0; i < code.size(); i++) {
      const auto word = [&](size_t at) {
        return at < code.size() &&
               (std::isalnum(static_cast<unsigned char>(code[at])) || code[at] == '_' || code[at] == '.');
      };
      const size_t which = static_cast<size_t>(code[i] - 'a');
      const bool is_operand = which < step.operands.size() && !(i > 0 && word(i - 1)) && !word(i + 1);
      // The condition of where() stays an integer even when the result is float.
      const bool condition = is_operand && which == 0 && std::strcmp(step.op->label, "where") == 0;
      text += is_operand ? operand(step.operands[which], condition ? Typing::cast_to : step.op->typing, step.dtype)
                         : std::string(1, code[i]);
    }
    return text;
  }

  void values(const std::string& index, const char* indent) {
    for (size_t i = 0; i < group.inputs.size(); i++)
      out << indent << "const " << register_type(group.inputs[i].dtype) << " a" << i << " = " << load(i, index)
          << ";\n";
    for (size_t i = 0; i < group.code.size(); i++) {
      const DType dtype = group.code[i].dtype;
      out << indent << "const " << register_type(dtype) << " v" << i << " = "
          << (dtype == DType::f16 ? "m_half" : text("(", register_type(dtype), ")")) << "(" << expression(group.code[i])
          << ");\n";
    }
  }

  void store(const GroupOutput& output, size_t i) {
    if (output.dtype == DType::f16)
      out << "      vstore_half(v" << output.value << ", i, r" << i << ");\n";
    else
      out << "      r" << i << "[i] = (" << c_type(output.dtype) << ")v" << output.value << ";\n";
  }

  std::vector<int> axes_where(bool reduced, bool with_inner) const {
    std::vector<int> axes;
    for (int axis = 0; axis < rank(); axis++)
      if ((layout.reduced >> axis & 1u) == static_cast<uint32_t>(reduced) && (with_inner || axis != inner()))
        axes.push_back(axis);
    return axes;
  }

  void pointers(const std::vector<int>& axes) {
    for (size_t i = 0; i < group.inputs.size(); i++)
      if (heir(i) < 0)
        out << "    __global const " << c_type(group.inputs[i].dtype) << "* p" << i << " = x" << i << " + "
            << base(i, axes) << ";\n";
  }

  void pointwise();
  void streamed_tiles();
  void reduce_inner();
  void reduce_outer();
  std::string combine(const std::string& to, const std::string& value) const;
  const char* identity() const;
  std::string reduced_value() const { return group.code.empty() ? "a0" : "v" + std::to_string(group.code.size() - 1); }
};

/// Whole tiles are computed into registers and stored past the caches.
void Writer::streamed_tiles() {
  const std::string tile = std::to_string(kStreamTile);
  out << "    if (stream)\n      for (; i + " << tile << " <= end; i += " << tile << ") {\n";
  for (size_t k = 0; k < group.outputs.size(); k++)
    out << "        " << c_type(group.outputs[k].dtype) << " t" << k << "[" << tile << "];\n";
  out << "        for (int l = 0; l < " << tile << "; l++) {\n          const int n = i + l;\n";
  values("n", "          ");
  for (size_t k = 0; k < group.outputs.size(); k++)
    out << "          t" << k << "[l] = (" << c_type(group.outputs[k].dtype) << ")v" << group.outputs[k].value << ";\n";
  out << "        }\n";
  for (size_t k = 0; k < group.outputs.size(); k++)
    out << "        for (int l = 0; l < " << tile << "; l += 8) STORE_PAST_CACHES(vload8(0, t" << k
        << " + l), (__global " << c_type(group.outputs[k].dtype) << "8*)(r" << k << " + i + l));\n";
  out << "      }\n";
}

void Writer::pointwise() {
  const std::vector<int> outer = axes_where(false, false);
  begin({"chunk", "rows", "stream"});
  out << "  int row_count = 1;\n";
  for (int axis : outer) out << "  row_count *= e" << axis << ";\n";
  out << "  const int row_end = min(row_count, ((int)get_global_id(1) + 1) * rows);\n"
      << "  for (int row = (int)get_global_id(1) * rows; row < row_end; row++) {\n";
  decompose(outer, "row");
  pointers(outer);
  for (size_t i = 0; i < group.outputs.size(); i++)
    out << "    __global " << c_type(group.outputs[i].dtype) << "* r" << i << " = y" << i << " + row * e" << inner()
        << ";\n";
  out << "    const int end = LOOP_HI(e" << inner() << ", chunk);\n    int i = LOOP_LO(chunk);\n";
  if (may_stream(group, layout)) streamed_tiles();
  out << "    for (; i < end; i += LOOP_STEP) {\n";
  values("i", "      ");
  for (size_t i = 0; i < group.outputs.size(); i++) store(group.outputs[i], i);
  out << "    }\n  }\n}\n";
}

std::string Writer::combine(const std::string& to, const std::string& value) const {
  if (group.reduce->reduction == Reduction::sum) return to + " = " + to + " + " + value + ";";
  const char* compare = group.reduce->reduction == Reduction::max ? " > " : " < ";
  return to + " = " + value + compare + to + " ? " + value + " : " + to + ";";
}

const char* Writer::identity() const {
  if (group.reduce->reduction == Reduction::sum) return "0";
  const bool max = group.reduce->reduction == Reduction::max;
  if (group.reduce_dtype == DType::i32) return max ? "INT_MIN" : "INT_MAX";
  if (group.reduce_dtype == DType::u32) return max ? "0" : "UINT_MAX";
  return max ? "-INFINITY" : "INFINITY";
}

/// The inner axis is reduced: a work-item takes kept indices in turn, and sums along the inner axis in 64 lanes.
void Writer::reduce_inner() {
  const std::vector<int> kept = axes_where(false, true), rows = axes_where(true, false);
  const std::string lanes = layout.serial ? "1" : std::to_string(kReduceLanes);
  const std::string n = "e" + std::to_string(inner());
  begin({"kept", "per_item", "length"});
  out << "  int count = " << n << ";\n";
  for (int axis : rows) out << "  count *= e" << axis << ";\n";
  out << "  const int t_end = min(count, ((int)get_global_id(1) + 1) * length);\n"
      << "  const int k_end = min(kept, ((int)get_global_id(0) + 1) * per_item);\n"
      << "  for (int k = (int)get_global_id(0) * per_item; k < k_end; k++) {\n";
  decompose(kept, "k");
  out << "    " << register_type(group.reduce_dtype) << " acc[" << lanes << "];\n    for (int l = 0; l < " << lanes
      << "; l++) acc[l] = " << identity() << ";\n"
      << "    for (int t = (int)get_global_id(1) * length; t < t_end;) {\n    const int first = t % " << n
      << ", row = t / " << n << ";\n";
  decompose(rows, "row");
  std::vector<int> outer = axes_where(false, false);
  outer.insert(outer.end(), rows.begin(), rows.end());
  pointers(outer);
  out << "    const int m = min(" << n << " - first, t_end - t);\n    t += m;\n";
  if (layout.serial) {
    out << "    for (int i = first; i < first + m; i++) {\n";
    values("i", "      ");
    out << "      " << combine("acc[0]", reduced_value()) << "\n    }\n";
  } else {
    out << "    for (int b = 0; b < m; b += " << lanes << ") {\n      const int w = min(" << lanes << ", m - b);\n"
        << "      for (int l = 0; l < w; l++) {\n        const int i = first + b + l;\n";
    values("i", "        ");
    out << "        " << combine("acc[l]", reduced_value()) << "\n      }\n    }\n";
  }
  out << "    }\n    for (int w = " << lanes << " / 2; w > 0; w >>= 1)\n      for (int l = 0; l < w; l++) { "
      << combine("acc[l]", "acc[l + w]") << " }\n"
      << "    y0[(int)get_global_id(1) * kept + k] = acc[0];\n  }\n}\n";
}

/// The inner axis is kept: a work-item owns a strip of columns and walks down the reduced rows.
void Writer::reduce_outer() {
  const std::vector<int> kept_rows = axes_where(false, false), reduced = axes_where(true, true);
  const std::string n = "e" + std::to_string(inner());
  begin({"kept", "per_item", "length"});
  out << "  int count = 1;\n";
  for (int axis : reduced) out << "  count *= e" << axis << ";\n";
  out << "  const int strips = (" << n << " + per_item - 1) / per_item;\n"
      << "  const int kept_row = (int)get_global_id(0) / strips, lo = ((int)get_global_id(0) % strips) * per_item;\n"
      << "  if (kept_row * " << n << " >= kept) return;\n  const int w = min(per_item, " << n << " - lo);\n";
  decompose(kept_rows, "kept_row");
  out << "  " << register_type(group.reduce_dtype) << " acc[CLOAM_CPU ? " << kReduceColumns
      << " : 1];\n  for (int l = 0; l < w; l++) acc[l] = " << identity() << ";\n"
      << "  const int t_end = min(count, ((int)get_global_id(1) + 1) * length);\n"
      << "  for (int t = (int)get_global_id(1) * length; t < t_end; t++) {\n";
  decompose(reduced, "t");
  std::vector<int> outer = kept_rows;
  outer.insert(outer.end(), reduced.begin(), reduced.end());
  pointers(outer);
  out << "    for (int l = 0; l < w; l++) {\n      const int i = lo + l;\n";
  values("i", "      ");
  out << "      " << combine("acc[l]", reduced_value()) << "\n    }\n  }\n"
      << "  for (int l = 0; l < w; l++) y0[(int)get_global_id(1) * kept + kept_row * " << n
      << " + lo + l] = acc[l];\n}\n";
}

std::string hash_name(const std::string& text) {
  char name[20];
  std::snprintf(name, sizeof name, "k%016llx", static_cast<unsigned long long>(fnv1a(text)));
  return name;
}

}  // namespace

bool may_stream(const Group& group, const Layout& layout) {
  if (!is_cpu_class() || layout.in_place || group.code.size() > kMaxStreamed) return false;
  return std::all_of(group.outputs.begin(), group.outputs.end(),
                     [](const GroupOutput& out) { return size_of(out.dtype) == 4; });
}

Generated generate(const Group& group, const Layout& layout) {
  Writer writer{group, layout};
  if (!group.reduce)
    writer.pointwise();
  else if (layout.inner_reduced())
    writer.reduce_inner();
  else
    writer.reduce_outer();
  const std::string body = writer.out.str(), name = hash_name(body);
  return {name, text("typedef struct { int at[", writer.words, "]; } ", name, "_words;\n__kernel FAT void ", name, "(",
                     name, "_words words, ", body)};
}

}  // namespace cloam
