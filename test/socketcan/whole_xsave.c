/* Restores part of a process's XSAVE area on any CPU, preloaded into user-mode Linux by in_can_kernel.
 *
 * User-mode Linux 6.1 saves and restores 2,696 bytes of the area. The host reads out as much as is asked for but
 * takes only the whole, which is longer where the CPU has AMX (EFAULT). Then the whole is read, the part replaced,
 * and the whole written.
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <elf.h>
#include <errno.h>
#include <stdarg.h>
#include <string.h>
#include <sys/ptrace.h>
#include <sys/types.h>
#include <sys/uio.h>

/* Not on the stack, which is one of user-mode Linux and short; one thread traces all of its processes. */
static char area[1 << 16];

long ptrace(enum __ptrace_request request, ...)
{
    static long (*next)(enum __ptrace_request, pid_t, void *, void *);
    va_list arguments;
    va_start(arguments, request);
    pid_t pid = va_arg(arguments, pid_t);
    void *address = va_arg(arguments, void *);
    void *data = va_arg(arguments, void *);
    va_end(arguments);

    if (!next)
        *(void **)&next = dlsym(RTLD_NEXT, "ptrace");
    long result = next(request, pid, address, data);
    if (result == 0 || errno != EFAULT || request != PTRACE_SETREGSET || address != (void *)NT_X86_XSTATE)
        return result;

    const struct iovec *part = data;
    struct iovec whole = {area, sizeof area};
    result = next(PTRACE_GETREGSET, pid, address, &whole);
    if (result || part->iov_len > whole.iov_len)
        return result ? result : -1;
    memcpy(area, part->iov_base, part->iov_len);
    return next(PTRACE_SETREGSET, pid, address, &whole);
}
