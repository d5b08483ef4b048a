// The kernels on this machine's processor: one block after the other, whose threads go from meeting to meeting in turns.

#define _XOPEN_SOURCE 700
#include <math.h>
#include <stddef.h>
#include <string.h>
#include <ucontext.h>

#define ABREAST 2

typedef struct {
    unsigned x, y;
} Place;
static Place threadIdx, blockIdx, blockDim, gridDim;

// Where every thread of the block is, and who sends them on.
static ucontext_t threads[BLOCK], all;
static char stacks[BLOCK][1 << 16];

static void meet(void)
{
    swapcontext(&threads[threadIdx.x], &all);
}

#define __global__ static
#define __device__ static
#define __shared__ static
#define __syncthreads() meet()

#include "kernels.cu"

// What the kernel is told: an address each.
static void **told;
#define A(i) (*(float **)told[i])
#define N(i) (*(unsigned **)told[i])
#define n(i) (*(unsigned *)told[i])
#define x(i) (*(float *)told[i])

static void run_dense(void) { dense(A(0), n(1), A(2), A(3), A(4), n(5), n(6)); }
static void run_dense_slope(void) { dense_slope(A(0), n(1), A(2), A(3), n(4), n(5), x(6), n(7)); }
static void run_dense_back(void) { dense_back(A(0), n(1), A(2), A(3), A(4), n(5), n(6)); }
static void run_place(void) { place(A(0), A(1), n(2), A(3), N(4), N(5), A(6), A(7), A(8), n(9)); }
static void run_walls(void) { walls(N(0), N(1), N(2), N(3), A(4), n(5), A(6), N(7), A(8), n(9)); }
static void run_patches(void) { patches(N(0), A(1), x(2), A(3), A(4), A(5), n(6)); }
static void run_gather(void)
{
    gather(N(0), N(1), A(2), N(3), N(4), A(5), A(6), A(7), N(8), N(9), N(10), A(11), A(12), A(13), N(14), A(15), x(16), x(17),
           x(18), x(19), x(20), A(21), A(22), A(23), A(24), N(25), x(26), n(27), n(28));
}
static void run_count(void) { count(A(0), n(1), A(2), N(3), n(4), x(5), x(6), A(7)); }
static void run_weigh(void) { weigh(A(0), A(1), A(2), n(3)); }
static void run_outer(void) { outer(A(0), A(1), A(2), n(3), n(4), x(5), n(6)); }
static void run_code_parts(void) { code_parts(A(0), A(1), A(2), n(3), n(4)); }
static void run_code_slope(void) { code_slope(A(0), n(1), A(2), A(3), n(4)); }
static void run_adam(void) { adam(A(0), A(1), A(2), A(3), x(4), x(5), x(6), x(7), n(8)); }
static void run_remember(void) { remember(A(0), A(1), x(2), n(3)); }
static void run_solve(void)
{
    solve(N(0), N(1), n(2), N(3), N(4), N(5), A(6), A(7), N(8), n(9), N(10), N(11), N(12), A(13), A(14), A(15), A(16), n(17),
          n(18));
}
static void run_lead(void) { lead(A(0), N(1), A(2), A(3), n(4), n(5)); }
static void run_farthest(void) { farthest(A(0), A(1), A(2), n(3), n(4), n(5)); }
static void run_shorten(void) { shorten(A(0), n(1), x(2), x(3), A(4)); }
static void run_move(void) { move(A(0), A(1), A(2), n(3)); }

static const struct {
    const char *name;
    void (*run)(void);
    unsigned args, meet;
} KERNELS[] = {
    {"dense", run_dense, 7, 0},
    {"dense_slope", run_dense_slope, 8, 0},
    {"dense_back", run_dense_back, 7, 0},
    {"place", run_place, 10, 0},
    {"walls", run_walls, 10, 0},
    {"patches", run_patches, 7, 1},
    {"gather", run_gather, 29, 1},
    {"count", run_count, 8, 1},
    {"weigh", run_weigh, 4, 0},
    {"outer", run_outer, 7, 0},
    {"code_parts", run_code_parts, 5, 1},
    {"code_slope", run_code_slope, 5, 0},
    {"adam", run_adam, 9, 0},
    {"remember", run_remember, 4, 0},
    {"solve", run_solve, 19, 1},
    {"lead", run_lead, 6, 0},
    {"farthest", run_farthest, 6, 1},
    {"shorten", run_shorten, 5, 1},
    {"move", run_move, 4, 0},
};

static void (*call)(void);
static int ended[BLOCK];

static void one_thread(void)
{
    call();
    ended[threadIdx.x] = 1;
}

// A block whose threads meet: each goes on to where it waits, then the next.
static void one_block(void)
{
    for (unsigned i = 0; i < blockDim.x; i++) {
        getcontext(&threads[i]);
        threads[i].uc_stack.ss_sp = stacks[i];
        threads[i].uc_stack.ss_size = sizeof stacks[i];
        threads[i].uc_link = &all;
        makecontext(&threads[i], one_thread, 0);
        ended[i] = 0;
    }
    for (unsigned left = blockDim.x; left;) {
        left = 0;
        for (threadIdx.x = 0; threadIdx.x < blockDim.x; threadIdx.x++)
            if (!ended[threadIdx.x]) {
                swapcontext(&all, &threads[threadIdx.x]);
                left += !ended[threadIdx.x];
            }
    }
}

// Runs a kernel; `args` ends with nothing. Not zero where there is no such kernel, or it has not as many arguments.
int launch(const char *name, unsigned across, unsigned down, unsigned block, void **args)
{
    unsigned n_args = 0, which = 0;
    const unsigned n_kernels = sizeof KERNELS / sizeof *KERNELS;
    while (args[n_args])
        n_args++;
    while (which < n_kernels && strcmp(KERNELS[which].name, name))
        which++;
    if (which == n_kernels || KERNELS[which].args != n_args || block > BLOCK)
        return 1;
    told = args;
    call = KERNELS[which].run;
    blockDim.x = block;
    gridDim.x = across;
    gridDim.y = down;
    for (blockIdx.y = 0; blockIdx.y < down; blockIdx.y++)
        for (blockIdx.x = 0; blockIdx.x < across; blockIdx.x++) {
            if (KERNELS[which].meet)
                one_block();
            else
                for (threadIdx.x = 0; threadIdx.x < block; threadIdx.x++)
                    call();
        }
    return 0;
}
