/*
 * Calls of compiled functions from Python at little cost.
 *
 * A Caller holds the address of a function of an emitted C module, and the shapes of its inputs and
 * outputs. Called with plain arrays of one state it calls the function and returns
 * new arrays; anything else goes to `general`, a Python function with the same arguments. So does
 * what comes out not finite, once more, to be reported, and every call until `bind` has told the
 * address.
 *
 * From Python 3.12 on the stable ABI has all that stands here: one extension serves every Python.
 */

#define PY_SSIZE_T_CLEAN
#include <Python.h>
#include <structmember.h>

#include <stdint.h>
#include <string.h>

#define NPY_NO_DEPRECATED_API NPY_1_22_API_VERSION
#include <numpy/arrayobject.h>

#include "arrays.h"

#define MAX_INPUTS 10
#define MAX_OUTPUTS 8
#define MAX_DIMENSIONS 4

typedef struct {
    int dimensions;
    npy_intp shape[MAX_DIMENSIONS];
} Shape;

typedef struct {
    PyObject_HEAD
    vectorcallfunc vectorcall;
    void (*function)(void);
    int inputs;
    int outputs;
    Shape taken[MAX_INPUTS];
    Shape made[MAX_OUTPUTS];
    PyObject *constants;
    const char *constants_data;
    Py_ssize_t constants_size;
    PyObject *general;
    PyObject *name;
    PyObject *doc;
    PyObject *weak_references;
} Caller;

/* The numbers of a plain array of one state, or NULL; those of a float are put into `number`. */
static double *plain_data(PyObject *object, const Shape *shape, double *number)
{
    if (shape->dimensions == 0 && PyFloat_CheckExact(object)) {
        *number = PyFloat_AsDouble(object);
        return number;
    }
    if (!PyArray_CheckExact(object)) {
        return NULL;
    }
    PyArrayObject *array = (PyArrayObject *)object;
    if (PyArray_TYPE(array) != NPY_DOUBLE || PyArray_NDIM(array) != shape->dimensions ||
        !PyArray_ISCARRAY_RO(array)) {
        return NULL;
    }
    for (int i = 0; i < shape->dimensions; ++i) {
        if (PyArray_DIM(array, i) != shape->shape[i]) {
            return NULL;
        }
    }
    return (double *)PyArray_DATA(array);
}

/* Constants given or those of the default parameters, or NULL where they are of another kind. */
static const void *constants_data(const Caller *self, PyObject *const *args, Py_ssize_t given,
                                  PyObject *names)
{
    const Py_ssize_t named = names ? PyTuple_Size(names) : 0;
    if (given == self->inputs && !named) {
        return self->constants_data;
    }
    if (given - self->inputs + named != 1 || given < self->inputs) {
        return NULL;
    }
    if (named && PyUnicode_CompareWithASCIIString(PyTuple_GetItem(names, 0), "constants") != 0) {
        return NULL;
    }
    PyObject *constants = args[self->inputs];
    if (constants == Py_None) {
        return self->constants_data;
    }
    if (!PyBytes_CheckExact(constants) || PyBytes_Size(constants) != self->constants_size) {
        return NULL;
    }
    return PyBytes_AsString(constants);
}

/* By their bits, since compilers that are told so take every number for finite. */
static int all_finite(PyObject *result)
{
    const double *numbers = (const double *)PyArray_DATA((PyArrayObject *)result);
    const npy_intp size = PyArray_SIZE((PyArrayObject *)result);
    for (npy_intp i = 0; i < size; ++i) {
        uint64_t bits;
        memcpy(&bits, numbers + i, sizeof bits);
        if (((bits >> 52) & 0x7ff) == 0x7ff) {
            return 0;
        }
    }
    return 1;
}

static PyObject *Caller_vectorcall(PyObject *object, PyObject *const *args, size_t flagged,
                                   PyObject *names)
{
    Caller *self = (Caller *)object;
    double *pointers[MAX_INPUTS + MAX_OUTPUTS];
    double numbers[MAX_INPUTS];
    PyObject *results[MAX_OUTPUTS];
    const void *constants = constants_data(self, args, PyVectorcall_NARGS(flagged), names);
    int i = 0;
    if (constants) {
        for (; i < self->inputs; ++i) {
            pointers[i] = plain_data(args[i], &self->taken[i], &numbers[i]);
            if (!pointers[i]) {
                break;
            }
        }
    }
    if (!constants || i < self->inputs || !self->function) {
        return PyObject_Vectorcall(self->general, args, flagged, names);
    }
    for (i = 0; i < self->outputs; ++i) {
        Shape *shape = &self->made[i];
        results[i] = PyArray_SimpleNew(shape->dimensions, shape->shape, NPY_DOUBLE);
        if (!results[i]) {
            while (i > 0) {
                Py_DECREF(results[--i]);
            }
            return NULL;
        }
        pointers[self->inputs + i] = (double *)PyArray_DATA((PyArrayObject *)results[i]);
    }
    call(self->function, constants, self->inputs + self->outputs, pointers);
    if (lost_here()) { /* Asking costs less than looking at results. */
        int finite = 1;
        for (i = 0; i < self->outputs; ++i) {
            finite = finite && all_finite(results[i]);
        }
        if (!finite) {
            for (i = 0; i < self->outputs; ++i) {
                Py_DECREF(results[i]);
            }
            return PyObject_Vectorcall(self->general, args, flagged, names);
        }
    }
    if (self->outputs == 1) {
        return results[0];
    }
    PyObject *all = PyTuple_New(self->outputs);
    for (i = 0; i < self->outputs; ++i) {
        if (all) {
            PyTuple_SetItem(all, i, results[i]);
        } else {
            Py_DECREF(results[i]);
        }
    }
    return all;
}

/* The number of shapes, of which there are `least` to `most`; or -1 with an error set. */
static int read_shapes(PyObject *shapes, int least, int most, Shape *read)
{
    const Py_ssize_t count = PyTuple_Size(shapes);
    if (count < least || count > most) {
        PyErr_Format(PyExc_ValueError, "%d to %d arrays", least, most);
        return -1;
    }
    for (int i = 0; i < (int)count; ++i) {
        PyObject *shape = PyTuple_GetItem(shapes, i);
        if (!PyTuple_Check(shape) || PyTuple_Size(shape) > MAX_DIMENSIONS) {
            PyErr_Format(PyExc_ValueError, "arrays have at most %d dimensions", MAX_DIMENSIONS);
            return -1;
        }
        read[i].dimensions = (int)PyTuple_Size(shape);
        for (int j = 0; j < read[i].dimensions; ++j) {
            read[i].shape[j] = PyLong_AsSsize_t(PyTuple_GetItem(shape, j));
        }
    }
    return PyErr_Occurred() ? -1 : (int)count;
}

/* Caller(taken, made, constants, general): the shapes of inputs and of outputs */
static PyObject *Caller_new(PyTypeObject *type, PyObject *args, PyObject *keywords)
{
    PyObject *taken, *made, *constants, *general;
    if (keywords && PyDict_Size(keywords)) {
        PyErr_SetString(PyExc_TypeError, "Caller takes no keywords");
        return NULL;
    }
    if (!PyArg_ParseTuple(args, "O!O!SO:Caller", &PyTuple_Type, &taken, &PyTuple_Type, &made,
                          &constants, &general)) {
        return NULL;
    }
    Caller *self = (Caller *)PyType_GenericAlloc(type, 0);
    if (!self) {
        return NULL;
    }
    self->vectorcall = Caller_vectorcall;
    self->constants = Py_NewRef(constants);
    self->constants_data = PyBytes_AsString(constants);
    self->constants_size = PyBytes_Size(constants);
    self->general = Py_NewRef(general);
    self->function = NULL;
    self->name = PyObject_GetAttrString(general, "__name__");
    self->doc = self->name ? PyObject_GetAttrString(general, "__doc__") : NULL;
    if (self->doc) {
        self->inputs = read_shapes(taken, 0, MAX_INPUTS, self->taken);
        self->outputs = self->inputs < 0 ? -1 : read_shapes(made, 1, MAX_OUTPUTS, self->made);
    }
    if (self->doc && self->inputs + self->outputs >= MAX_ARRAYS) {
        PyErr_Format(PyExc_ValueError, "at most %d arrays in all", MAX_ARRAYS - 1);
        self->outputs = -1;
    }
    if (!self->doc || self->outputs < 0) {
        Py_DECREF(self);
        return NULL;
    }
    return (PyObject *)self;
}

static int Caller_traverse(PyObject *object, visitproc visit, void *arg)
{
    Caller *self = (Caller *)object;
    Py_VISIT(Py_TYPE(object));
    Py_VISIT(self->general);
    return 0;
}

static int Caller_clear(PyObject *object)
{
    Caller *self = (Caller *)object;
    Py_CLEAR(self->constants);
    Py_CLEAR(self->general);
    Py_CLEAR(self->name);
    Py_CLEAR(self->doc);
    return 0;
}

static void Caller_dealloc(PyObject *object)
{
    PyTypeObject *type = Py_TYPE(object);
    PyObject_GC_UnTrack(object);
    PyObject_ClearWeakRefs(object);
    (void)Caller_clear(object);
    PyObject_GC_Del(object);
    Py_DECREF(type);
}

static PyObject *Caller_repr(PyObject *object)
{
    return PyUnicode_FromFormat("<compiled function %U>", ((Caller *)object)->name);
}

/* Refused in the words of the general function. */
static PyObject *Caller_reduce(PyObject *object, PyObject *unused)
{
    (void)unused;
    return PyObject_CallMethod(((Caller *)object)->general, "__reduce__", NULL);
}

/* Nothing of it changes, so that a copy is the object itself. */
static PyObject *Caller_copy(PyObject *object, PyObject *unused)
{
    (void)unused;
    return Py_NewRef(object);
}

/* The address of the function, once it is compiled. */
static PyObject *Caller_bind(PyObject *object, PyObject *address)
{
    void (*function)(void) = (void (*)(void))PyLong_AsVoidPtr(address);
    if (PyErr_Occurred()) {
        return NULL;
    }
    ((Caller *)object)->function = function;
    return Py_NewRef(Py_None);
}

static PyMethodDef methods[] = {
    {"bind", Caller_bind, METH_O, NULL},
    {"__reduce__", Caller_reduce, METH_NOARGS, NULL},
    {"__copy__", Caller_copy, METH_NOARGS, NULL},
    {"__deepcopy__", Caller_copy, METH_O, NULL},
    {NULL, NULL, 0, NULL},
};

static PyMemberDef members[] = {
    {"__vectorcalloffset__", T_PYSSIZET, offsetof(Caller, vectorcall), READONLY, NULL},
    {"__weaklistoffset__", T_PYSSIZET, offsetof(Caller, weak_references), READONLY, NULL},
    {"__wrapped__", T_OBJECT, offsetof(Caller, general), READONLY, NULL},
    {"__name__", T_OBJECT, offsetof(Caller, name), READONLY, NULL},
    {"__doc__", T_OBJECT, offsetof(Caller, doc), READONLY, NULL},
    {NULL, 0, 0, 0, NULL},
};

static PyType_Slot slots[] = {
    {Py_tp_new, Caller_new},
    {Py_tp_call, PyVectorcall_Call},
    {Py_tp_dealloc, Caller_dealloc},
    {Py_tp_traverse, Caller_traverse},
    {Py_tp_clear, Caller_clear},
    {Py_tp_repr, Caller_repr},
    {Py_tp_members, members},
    {Py_tp_methods, methods},
    {0, NULL},
};

static PyType_Spec spec = {
    .name = "gibbs_codegen.runtime._caller.Caller",
    .basicsize = sizeof(Caller),
    .flags = Py_TPFLAGS_DEFAULT | Py_TPFLAGS_HAVE_GC | Py_TPFLAGS_HAVE_VECTORCALL |
             Py_TPFLAGS_IMMUTABLETYPE,
    .slots = slots,
};

static struct PyModuleDef module = {
    PyModuleDef_HEAD_INIT,
    .m_name = "gibbs_codegen.runtime._caller",
    .m_size = -1,
};

PyMODINIT_FUNC PyInit__caller(void)
{
    import_array();
    PyObject *made = PyModule_Create(&module);
    if (!made) {
        return NULL;
    }
    PyObject *type = PyType_FromSpec(&spec);
    if (!type || PyModule_AddObjectRef(made, "Caller", type) < 0) {
        Py_XDECREF(type);
        Py_DECREF(made);
        return NULL;
    }
    Py_DECREF(type);
    return made;
}
