"""Reading ahead: memory that is used soon is asked for now, so that it is in the processor's cache by then."""

from __future__ import annotations

from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic

_READ, _KEEP, _DATA = 0, 3, 1  # arguments of LLVM's llvm.prefetch


@intrinsic
def prefetch(typingctx, array, index, offset):
    """Ask for the cache line at ``array[index]``, a number or a row, and ``offset`` bytes on; nothing is read: any index will do."""

    def generate(context, builder, signature, arguments):
        kind = signature.args[0]
        data = context.make_array(kind)(context, builder, arguments[0])
        row, byte = (context.cast(builder, value, of, types.intp) for value, of in zip(arguments[1:], signature.args[1:]))
        row = builder.mul(row, cgutils.unpack_tuple(builder, data.strides, kind.ndim)[0])
        address = builder.add(builder.ptrtoint(data.data, row.type), builder.add(row, byte))
        pointer, number = ir.IntType(8).as_pointer(), ir.IntType(32)
        function = ir.FunctionType(ir.VoidType(), [pointer, *[number] * 3])
        call = cgutils.get_or_insert_function(builder.module, function, "llvm.prefetch.p0i8")
        builder.call(call, [builder.inttoptr(address, pointer), *(number(k) for k in (_READ, _KEEP, _DATA))])
        return context.get_dummy_value()

    return types.none(array, index, offset), generate
