/*
 * Time steps call the functions above, in the same words for one state, where `lanes` is 1, and for
 * a block of states, where it is LANES.
 */
#ifdef EACH
#define CALL(function, ...) function##_block(__VA_ARGS__)
#else
#define CALL(function, ...) \
    do { \
        if (lanes == 1) { \
            MODULE(function)(__VA_ARGS__); \
        } else { \
            function##_block(__VA_ARGS__); \
        } \
    } while (0)
#endif
/* Entries, and lanes, are independent. gcc vectorises loops over them that it does not unroll. */
#if defined(__GNUC__) && !defined(__clang__) && __GNUC__ >= 8
#define ENTRYWISE _Pragma("GCC ivdep") _Pragma("GCC unroll 1")
#else
#define ENTRYWISE VECTORISE
#endif
