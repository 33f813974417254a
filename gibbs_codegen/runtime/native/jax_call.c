/*
 * Calls of compiled functions from XLA, on the CPU: one target for the functions of all modules.
 *
 * A call names its function, which Python has added beforehand: an address in the call would mean
 * something else in another process that takes the compiled program from JAX's cache. Every
 * argument and result has its entries along the last axis, and the axes of the batch before it,
 * which are of length 1 where an argument is the same along them. Constants, where given, are the
 * last argument. All are float64, or all float32, which is computed in double precision.
 */

#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>

#include "xla/ffi/api/c_api.h"

#include "arrays.h"

typedef void Batch(void);

/*
 * A function of a module; `widths` are those of inputs, outputs and constants. `batch_each` takes
 * constants of each state; it is NULL until it is added.
 */
typedef struct Function {
    struct Function *next;
    BatchCall *rows;
    Batch *batch;
    _Atomic(Batch *) batch_each;
    const double *constants;
    int inputs, outputs;
    size_t widths[MAX_ARRAYS];
    char name[];
} Function;

static _Atomic(Function *) functions;

int gibbs_codegen_jax_add(
    const char *name,
    BatchCall *rows,
    void (*batch)(void),
    const double *constants,
    int inputs,
    int outputs,
    const size_t *widths);
int gibbs_codegen_jax_add_each(const char *name, void (*batch_each)(void));
XLA_FFI_Error *gibbs_codegen_jax_call(XLA_FFI_CallFrame *frame);

/* Add a function, of which nothing is freed: programs that XLA has compiled may call it to the end.
 * Python's lock lets one thread at a time in. Returns 0, or -1 where it cannot be added. */
int gibbs_codegen_jax_add(
    const char *name,
    BatchCall *rows,
    void (*batch)(void),
    const double *constants,
    int inputs,
    int outputs,
    const size_t *widths)
{
    const size_t length = strlen(name) + 1;
    Function *added = malloc(sizeof *added + length);
    if (!added || inputs + outputs + 1 > MAX_ARRAYS) {
        free(added);
        return -1;
    }
    added->rows = rows;
    added->batch = batch;
    atomic_init(&added->batch_each, NULL);
    added->constants = constants;
    added->inputs = inputs;
    added->outputs = outputs;
    memcpy(added->widths, widths, (size_t)(inputs + outputs + 1) * sizeof *widths);
    memcpy(added->name, name, length);
    added->next = atomic_load(&functions);
    atomic_store(&functions, added);
    return 0;
}

/* The function of a name; NULL where this process has none. */
static Function *named(const char *name, size_t length)
{
    Function *found = atomic_load(&functions);
    while (found && (strlen(found->name) != length || memcmp(found->name, name, length))) {
        found = found->next;
    }
    return found;
}

/* Add to a function its form for constants of each state. Returns 0, or -1 without the function. */
int gibbs_codegen_jax_add_each(const char *name, void (*batch_each)(void))
{
    Function *function = named(name, strlen(name));
    if (!function) {
        return -1;
    }
    atomic_store(&function->batch_each, batch_each);
    return 0;
}

static XLA_FFI_Error *failed(const XLA_FFI_CallFrame *frame, const char *message)
{
    XLA_FFI_Error_Create_Args error = {
        XLA_FFI_Error_Create_Args_STRUCT_SIZE, NULL, message, XLA_FFI_Error_Code_INTERNAL};
    return frame->api->XLA_FFI_Error_Create(&error);
}

/* The function that the only attribute of a call names; NULL where this process has none. */
static const Function *called(const XLA_FFI_Attrs *attributes)
{
    if (attributes->size != 1 || attributes->types[0] != XLA_FFI_AttrType_STRING) {
        return NULL;
    }
    const XLA_FFI_ByteSpan *name = attributes->attrs[0];
    return named(name->ptr, name->len);
}

/* Where an argument has the row of a state, if results have `batch`. */
static size_t row_of(const XLA_FFI_Buffer *argument, const XLA_FFI_Buffer *batch, size_t state)
{
    size_t row = 0, step = 1;
    for (int64_t axis = batch->rank - 2; axis >= 0; --axis) {
        const size_t length = (size_t)batch->dims[axis];
        if (argument->dims[axis] != 1) {
            row += state % length * step;
            step *= length;
        }
        state /= length;
    }
    return row;
}

static size_t states_of(const XLA_FFI_Buffer *buffer)
{
    size_t states = 1;
    for (int64_t axis = 0; axis < buffer->rank - 1; ++axis) {
        states *= (size_t)buffer->dims[axis];
    }
    return states;
}

/* Rows of some states of an argument, one after the other, in double precision. */
static void gather(
    const XLA_FFI_Buffer *argument,
    const XLA_FFI_Buffer *batch,
    size_t first,
    size_t count,
    size_t width,
    double *rows)
{
    for (size_t i = 0; i < count; ++i, rows += width) {
        const size_t from = row_of(argument, batch, first + i) * width;
        if (argument->dtype == XLA_FFI_DataType_F64) {
            memcpy(rows, (const double *)argument->data + from, width * sizeof *rows);
            continue;
        }
        for (size_t k = 0; k < width; ++k) {
            rows[k] = (double)((const float *)argument->data)[from + k];
        }
    }
}

/*
 * All states: at once where arguments and results are as `rows` takes them, else block by block, or
 * one by one where each has its own constants and the function has no form for these. `buffers` are
 * those of arguments and results, and of constants, if they are `given`. `scratch` holds 2 LANES
 * states of all arrays.
 */
static void all_states(
    const Function *function, XLA_FFI_Buffer *const *buffers, int given, double *scratch)
{
    const int inputs = function->inputs, number = inputs + function->outputs;
    const XLA_FFI_Buffer *batch = buffers[inputs];
    const size_t states = states_of(batch);
    const int whole = batch->dtype == XLA_FFI_DataType_F64;
    const int many_constants = given && states_of(buffers[number]) > 1;
    Batch *batch_each = many_constants ? atomic_load(&function->batch_each) : NULL;
    double *own[MAX_ARRAYS], *arrays[MAX_ARRAYS];
    int is_direct[MAX_ARRAYS], all_direct = 1;
    for (int i = 0; i <= number; ++i) {
        const int taken = i < number || batch_each;
        own[i] = scratch;
        scratch += LANES * function->widths[i];
        is_direct[i] = taken && whole && states_of(buffers[i]) == states;
        all_direct = all_direct && (is_direct[i] || !taken);
    }
    const int one_by_one = many_constants && !batch_each;
    const size_t step = one_by_one ? 1 : all_direct ? states : LANES;
    const double *constants = batch_each ? NULL : given ? own[number] : function->constants;
    for (size_t first = 0; first < states; first += step) {
        const size_t count = states - first < step ? states - first : step;
        if (constants && given && (one_by_one || first == 0)) {
            gather(buffers[number], batch, first, 1, function->widths[number], own[number]);
        }
        for (int i = 0; i < number + (batch_each != NULL); ++i) {
            const size_t width = function->widths[i];
            arrays[i] = is_direct[i] ? (double *)buffers[i]->data + first * width : own[i];
            if ((i < inputs || i == number) && !is_direct[i]) {
                gather(buffers[i], batch, first, count, width, own[i]);
            }
        }
        function->rows(
            batch_each ? batch_each : function->batch,
            constants,
            count,
            inputs,
            number - inputs,
            function->widths,
            arrays,
            scratch);
        for (int i = inputs; i < number; ++i) {
            float *to = (float *)buffers[i]->data + first * function->widths[i];
            for (size_t k = 0; !whole && k < count * function->widths[i]; ++k) {
                to[k] = (float)own[i][k];
            }
        }
    }
}

/* Whether a buffer has rows of a width, in the precision and with the batch's axes of `like`. */
static int fits(const XLA_FFI_Buffer *buffer, const XLA_FFI_Buffer *like, size_t width)
{
    return buffer->dtype == like->dtype && buffer->rank == like->rank && buffer->rank > 0 &&
           (size_t)buffer->dims[buffer->rank - 1] == width;
}

/* The target. XLA also calls it to ask which version of its interface this is. */
XLA_FFI_Error *gibbs_codegen_jax_call(XLA_FFI_CallFrame *frame)
{
    if (frame->extension_start && frame->extension_start->type == XLA_FFI_Extension_Metadata) {
        XLA_FFI_Metadata *metadata =
            ((XLA_FFI_Metadata_Extension *)frame->extension_start)->metadata;
        metadata->api_version.major_version = XLA_FFI_API_MAJOR;
        metadata->api_version.minor_version = XLA_FFI_API_MINOR;
        return NULL;
    }
    const Function *function = called(&frame->attrs);
    if (!function) {
        return failed(
            frame, "gibbs_codegen: load the module before a program that calls it is run");
    }
    const int number = function->inputs + function->outputs;
    const int has_constants = frame->args.size == function->inputs + 1;
    if ((frame->args.size != function->inputs && !has_constants) ||
        frame->rets.size != function->outputs) {
        return failed(frame, "gibbs_codegen: a call has another number of arguments or results");
    }
    XLA_FFI_Buffer *buffers[MAX_ARRAYS];
    XLA_FFI_Buffer *given = has_constants ? frame->args.args[function->inputs] : NULL;
    size_t size = 0;
    for (int i = 0; i < number; ++i) {
        buffers[i] = i < function->inputs ? frame->args.args[i]
                                          : frame->rets.rets[i - function->inputs];
    }
    buffers[number] = given ? given : buffers[function->inputs];
    const XLA_FFI_Buffer *like = buffers[function->inputs];
    for (int i = 0; i <= number; ++i) {
        size += 2 * LANES * function->widths[i];
        if ((i < number || given) && !fits(buffers[i], like, function->widths[i])) {
            return failed(
                frame, "gibbs_codegen: an argument or a result has another shape or type");
        }
    }
    if (like->dtype != XLA_FFI_DataType_F64 && like->dtype != XLA_FFI_DataType_F32) {
        return failed(frame, "gibbs_codegen: arguments are neither float64 nor float32");
    }
    /* Blocks that begin where a cache line does are faster. */
    char *memory = malloc(size * sizeof(double) + 64);
    if (!memory) {
        return failed(frame, "gibbs_codegen: out of memory");
    }
    all_states(function, buffers, given != NULL, (double *)(memory + (64 - (size_t)memory % 64)));
    free(memory);
    return NULL;
}
