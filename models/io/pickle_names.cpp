// See pickle_names.h.
#include "models/io/pickle_names.h"

namespace cloam {
namespace {

// Whatever is not here is refused by name. Old and new spellings: numpy 2 moved numpy.core, pandas 0.20 and 2 indexes.
constexpr AllowedName kOfDataFrames[] = {
    {"pandas.core.frame DataFrame", PickleName::data_frame},
    {"pandas.core.internals.managers BlockManager", PickleName::block_manager},
    {"pandas.core.internals BlockManager", PickleName::block_manager},
    {"pandas._libs.internals _unpickle_block", PickleName::unpickle_block},
    {"pandas.core.indexes.base _new_Index", PickleName::new_index},
    {"pandas.indexes.base _new_Index", PickleName::new_index},
    {"pandas.core.indexes.base Index", PickleName::index},
    {"pandas.indexes.base Index", PickleName::index},
    {"pandas.core.indexes.numeric Int64Index", PickleName::index},
    {"pandas.core.indexes.numeric UInt64Index", PickleName::index},
    {"pandas.core.indexes.numeric Float64Index", PickleName::index},
    {"pandas.indexes.numeric Int64Index", PickleName::index},
    {"pandas.core.indexes.range RangeIndex", PickleName::range_index},
    {"pandas.indexes.range RangeIndex", PickleName::range_index},
    {"numpy.core.multiarray _reconstruct", PickleName::reconstruct},
    {"numpy._core.multiarray _reconstruct", PickleName::reconstruct},
    {"numpy.core.numeric _frombuffer", PickleName::from_buffer},
    {"numpy._core.numeric _frombuffer", PickleName::from_buffer},
    {"numpy.core.multiarray scalar", PickleName::scalar},
    {"numpy._core.multiarray scalar", PickleName::scalar},
    {"numpy ndarray", PickleName::array},
    {"numpy dtype", PickleName::dtype},
    {"builtins slice", PickleName::slice},
    {"__builtin__ slice", PickleName::slice},
    {"_codecs encode", PickleName::encode},
    {"builtins bytes", PickleName::bytes},
    {"__builtin__ bytes", PickleName::bytes},
    {"builtins bytearray", PickleName::bytes},
    {"__builtin__ bytearray", PickleName::bytes},
    {"pandas._libs.arrays __pyx_unpickle_NDArrayBacked", PickleName::other},
    {"pandas._libs.tslibs.timestamps _unpickle_timestamp", PickleName::other},
    {"pandas._libs.tslibs.timestamps Timestamp", PickleName::other},
    {"pandas._libs.tslibs.nattype _nat_unpickle", PickleName::other},
    {"pandas.core.arrays.datetimes DatetimeArray", PickleName::other},
    {"pandas.core.arrays.timedeltas TimedeltaArray", PickleName::other},
    {"pandas.core.arrays.categorical Categorical", PickleName::other},
    {"pandas.core.dtypes.dtypes CategoricalDtype", PickleName::other},
    {"pandas.core.dtypes.dtypes DatetimeTZDtype", PickleName::other},
    {"pandas.core.indexes.datetimes _new_DatetimeIndex", PickleName::other},
    {"pandas.core.indexes.datetimes DatetimeIndex", PickleName::other},
};

// Tensors have been functions' results since PyTorch 0.2, and objects with a state before.
constexpr AllowedName kOfTensors[] = {
    {"collections OrderedDict", PickleName::ordered_dict},   {"torch._utils _rebuild_tensor", PickleName::tensor},
    {"torch._utils _rebuild_tensor_v2", PickleName::tensor}, {"torch FloatTensor", PickleName::tensor},
    {"torch.cuda FloatTensor", PickleName::tensor},          {"torch._utils _rebuild_parameter", PickleName::parameter},
    {"torch.nn.parameter Parameter", PickleName::parameter}, {"torch Size", PickleName::size},
    {"torch DoubleStorage", PickleName::storage_f64},        {"torch FloatStorage", PickleName::storage_f32},
    {"torch.cuda FloatStorage", PickleName::storage_f32},    {"torch HalfStorage", PickleName::storage_f16},
    {"torch.cuda HalfStorage", PickleName::storage_f16},     {"torch BFloat16Storage", PickleName::storage_bf16},
    {"torch LongStorage", PickleName::storage_i64},          {"torch.cuda LongStorage", PickleName::storage_i64},
    {"torch IntStorage", PickleName::storage_i32},           {"torch ShortStorage", PickleName::storage_i16},
    {"torch CharStorage", PickleName::storage_i8},           {"torch ByteStorage", PickleName::storage_u8},
    {"torch BoolStorage", PickleName::storage_bool},
};

}  // namespace

const Dialect& dialect_of(PickleUse use) {
  static const Dialect frames = {kOfDataFrames, "only pandas data frames of numpy arrays are read", "a data frame"};
  static const Dialect tensors = {kOfTensors, "only a state_dict() of PyTorch, as torch.save writes it, is read",
                                  "a file of tensors"};
  return use == PickleUse::data_frame ? frames : tensors;
}

}  // namespace cloam
