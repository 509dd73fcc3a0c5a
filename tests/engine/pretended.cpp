// NVIDIA's driver as far as `stickslip/engine/cuda.py` uses it, on the processor: memory is that of the process, a module is
// a library, and the threads of a kernel run one after the other.
#include <dlfcn.h>
#include <stdlib.h>
#include <string.h>

typedef unsigned long long address;
typedef void launch(unsigned grid, unsigned block, void **arguments);

static int live = 0, contexts = 0;
static thread_local void *current = nullptr;

extern "C" {
int pretended_live() { return live; }
int cuInit(unsigned) { return 0; }
int cuGetErrorString(int outcome, const char **text)
{
    *text = outcome == 201 ? "invalid device context" : "no kernel image is available for execution on the device";
    return 0;
}
int cuDeviceGet(int *device, int number) { *device = number; return 0; }
int cuDeviceGetAttribute(int *value, int attribute, int) { *value = attribute == 75 ? 9 : 0; return 0; }
int cuDevicePrimaryCtxRetain(void **context, int) { *context = &contexts; return 0; }
int cuCtxSetCurrent(void *context) { current = context; return 0; }
int cuModuleLoadData(void **module, const void *image)
{
    *module = dlopen((const char *)image, RTLD_NOW | RTLD_LOCAL);
    return *module == nullptr ? 209 : 0;
}
int cuModuleGetFunction(void **function, void *module, const char *name)
{
    *function = dlsym(module, name) == nullptr ? nullptr : dlsym(module, "launch");
    return *function == nullptr ? 500 : 0;
}
int cuStreamCreate(void **stream, unsigned) { *stream = &live; live++; return current == nullptr ? 201 : 0; }
int cuStreamSynchronize(void *) { return 0; }
int cuStreamDestroy_v2(void *) { live--; return 0; }
int cuMemAlloc_v2(address *memory, size_t size) { *memory = (address)malloc(size); live++; return current == nullptr ? 201 : 0; }
int cuMemFree_v2(address memory) { free((void *)memory); live--; return 0; }
int cuMemcpyHtoDAsync_v2(address to, const void *from, size_t size, void *) { memcpy((void *)to, from, size); return 0; }
int cuMemcpyDtoHAsync_v2(void *to, address from, size_t size, void *) { memcpy(to, (void *)from, size); return 0; }
int cuLaunchKernel(void *function, unsigned grid, unsigned, unsigned, unsigned block, unsigned, unsigned, unsigned, void *,
                   void **arguments, void **)
{
    ((launch *)function)(grid, block, arguments);
    return 0;
}
}
