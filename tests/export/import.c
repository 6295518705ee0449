// Reads a projector's pictures out of the daemon's own memory, as any other program may: connects to the control socket, receives
// descriptors with the reply to export.open, imports them in a Vulkan instance of its own, and copies what is in them.
//
//   import SOCKET PROJECTOR OUT [COUNT]
//
// Writes OUT.N.rgba and OUT.N.depth, N from 0: rows without gaps, for COUNT pictures (1 where it is not said). After each it says
// "picture N …" on the standard output, and reads on where a line comes on the standard input.
#define _GNU_SOURCE
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>
#include <vulkan/vulkan.h>

#define MAX_LINE 65536
#define MAX_FDS 8

static void die(const char *what) {
    fprintf(stderr, "import: %s\n", what);
    exit(1);
}

static void must(VkResult result, const char *what) {
    if (result != VK_SUCCESS) {
        fprintf(stderr, "import: %s: %d\n", what, result);
        exit(1);
    }
}

// What the daemon says, and what came with it.

static int connection, fds[MAX_FDS], fd_count;
static char received[MAX_LINE];
static size_t received_bytes;

static void receive(void) {
    char control[CMSG_SPACE(sizeof fds)];
    struct iovec space = {received + received_bytes, sizeof received - received_bytes};
    struct msghdr message = {.msg_iov = &space, .msg_iovlen = 1, .msg_control = control, .msg_controllen = sizeof control};
    ssize_t length = recvmsg(connection, &message, MSG_CMSG_CLOEXEC);
    if (length <= 0 || (message.msg_flags & MSG_CTRUNC)) die("the daemon has closed the connection");
    received_bytes += (size_t)length;
    for (struct cmsghdr *at = CMSG_FIRSTHDR(&message); at; at = CMSG_NXTHDR(&message, at)) {
        if (at->cmsg_level != SOL_SOCKET || at->cmsg_type != SCM_RIGHTS) continue;
        size_t count = (at->cmsg_len - CMSG_LEN(0)) / sizeof(int);
        if (fd_count + count > MAX_FDS) die("more descriptors than expected");
        memcpy(fds + fd_count, CMSG_DATA(at), count * sizeof(int));
        fd_count += (int)count;
    }
}

static void next_line(char *line) {
    char *end;
    while (!(end = memchr(received, '\n', received_bytes))) {
        if (received_bytes == sizeof received) die("a line is too long");
        receive();
    }
    size_t length = (size_t)(end - received);
    memcpy(line, received, length);
    line[length] = 0;
    received_bytes -= length + 1;
    memmove(received, end + 1, received_bytes);
}

static void say(const char *text) {
    if (write(connection, text, strlen(text)) != (ssize_t)strlen(text)) die("the daemon takes no more");
}

// The value of a key, of an object inside where `inside` says so; the daemon writes JSON without spaces.
static const char *value_of(const char *line, const char *inside, const char *key) {
    char name[64];
    if (inside) {
        snprintf(name, sizeof name, "\"%s\":{", inside);
        if (!(line = strstr(line, name))) die(inside);
    }
    snprintf(name, sizeof name, "\"%s\":", key);
    const char *at = strstr(line, name);
    if (!at) die(key);
    return at + strlen(name);
}

static uint64_t number(const char *line, const char *inside, const char *key) {
    return strtoull(value_of(line, inside, key), NULL, 10);
}

static bool is(const char *value, const char *expected) {
    return strncmp(value, expected, strlen(expected)) == 0;
}

// The device that has the memory.

static VkInstance instance;
static VkPhysicalDevice physical;
static VkDevice device;
static VkQueue queue;
static uint32_t family;
static VkCommandPool pool;

// A UUID as the daemon writes it: hexadecimal digits in groups.
static bool same_uuid(const uint8_t *uuid, const char *text) {
    for (unsigned i = 0; i < VK_UUID_SIZE; i++) {
        if (*text == '-') text++;
        char digits[3] = {text[0], text[1], 0};
        if (strtoul(digits, NULL, 16) != uuid[i]) return false;
        text += 2;
    }
    return true;
}

static void open_device(const char *opened, bool with_semaphore) {
    VkApplicationInfo application = {.sType = VK_STRUCTURE_TYPE_APPLICATION_INFO, .apiVersion = VK_API_VERSION_1_3};
    VkInstanceCreateInfo instance_info = {.sType = VK_STRUCTURE_TYPE_INSTANCE_CREATE_INFO, .pApplicationInfo = &application};
    must(vkCreateInstance(&instance_info, NULL, &instance), "making an instance");
    VkPhysicalDevice all[16];
    uint32_t count = 16;
    vkEnumeratePhysicalDevices(instance, &count, all);
    for (uint32_t i = 0; i < count && !physical; i++) {
        VkPhysicalDeviceIDProperties id = {.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_ID_PROPERTIES};
        VkPhysicalDeviceProperties2 properties = {.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_PROPERTIES_2, .pNext = &id};
        vkGetPhysicalDeviceProperties2(all[i], &properties);
        if (same_uuid(id.deviceUUID, value_of(opened, NULL, "device_uuid") + 1) &&
            same_uuid(id.driverUUID, value_of(opened, NULL, "driver_uuid") + 1))
            physical = all[i];
    }
    if (!physical) die("no device here is the daemon's");

    VkQueueFamilyProperties families[16];
    count = 16;
    vkGetPhysicalDeviceQueueFamilyProperties(physical, &count, families);
    while (family < count && !(families[family].queueFlags & (VK_QUEUE_GRAPHICS_BIT | VK_QUEUE_COMPUTE_BIT))) family++;
    float priority = 1;
    VkDeviceQueueCreateInfo queue_info = {.sType = VK_STRUCTURE_TYPE_DEVICE_QUEUE_CREATE_INFO, .queueFamilyIndex = family,
                                          .queueCount = 1, .pQueuePriorities = &priority};
    const char *extensions[] = {"VK_KHR_external_memory_fd", "VK_KHR_external_semaphore_fd"};
    VkPhysicalDeviceTimelineSemaphoreFeatures timelines = {
        .sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_TIMELINE_SEMAPHORE_FEATURES, .timelineSemaphore = VK_TRUE};
    VkDeviceCreateInfo device_info = {.sType = VK_STRUCTURE_TYPE_DEVICE_CREATE_INFO, .pNext = &timelines,
                                      .queueCreateInfoCount = 1, .pQueueCreateInfos = &queue_info,
                                      .enabledExtensionCount = with_semaphore ? 2 : 1, .ppEnabledExtensionNames = extensions};
    must(vkCreateDevice(physical, &device_info, NULL, &device), "opening the device");
    vkGetDeviceQueue(device, family, 0, &queue);
    VkCommandPoolCreateInfo pool_info = {.sType = VK_STRUCTURE_TYPE_COMMAND_POOL_CREATE_INFO, .queueFamilyIndex = family,
                                         .flags = VK_COMMAND_POOL_CREATE_RESET_COMMAND_BUFFER_BIT};
    must(vkCreateCommandPool(device, &pool_info, NULL, &pool), "making a command pool");
}

// An image of the daemon's as a buffer of ours; the descriptor is Vulkan's from then on.
static VkBuffer import(int fd, const char *opened) {
    VkExternalMemoryBufferCreateInfo external = {.sType = VK_STRUCTURE_TYPE_EXTERNAL_MEMORY_BUFFER_CREATE_INFO,
                                                 .handleTypes = VK_EXTERNAL_MEMORY_HANDLE_TYPE_OPAQUE_FD_BIT};
    VkBufferCreateInfo info = {.sType = VK_STRUCTURE_TYPE_BUFFER_CREATE_INFO, .pNext = &external,
                               .size = number(opened, "buffer", "bytes"),
                               .usage = (VkBufferUsageFlags)number(opened, "buffer", "usage")};
    VkBuffer buffer;
    must(vkCreateBuffer(device, &info, NULL, &buffer), "making a buffer");
    VkMemoryDedicatedAllocateInfo dedicated = {.sType = VK_STRUCTURE_TYPE_MEMORY_DEDICATED_ALLOCATE_INFO, .buffer = buffer};
    VkImportMemoryFdInfoKHR imported = {.sType = VK_STRUCTURE_TYPE_IMPORT_MEMORY_FD_INFO_KHR,
                                        .pNext = is(value_of(opened, "memory", "dedicated"), "true") ? &dedicated : NULL,
                                        .handleType = VK_EXTERNAL_MEMORY_HANDLE_TYPE_OPAQUE_FD_BIT, .fd = fd};
    VkMemoryAllocateInfo allocation = {.sType = VK_STRUCTURE_TYPE_MEMORY_ALLOCATE_INFO, .pNext = &imported,
                                       .allocationSize = number(opened, "memory", "bytes"),
                                       .memoryTypeIndex = (uint32_t)number(opened, "memory", "type")};
    VkDeviceMemory memory;
    must(vkAllocateMemory(device, &allocation, NULL, &memory), "importing the memory");
    must(vkBindBufferMemory(device, buffer, memory, 0), "binding the memory");
    return buffer;
}

static VkSemaphore import_timeline(int fd) {
    VkSemaphoreTypeCreateInfo type = {.sType = VK_STRUCTURE_TYPE_SEMAPHORE_TYPE_CREATE_INFO,
                                      .semaphoreType = VK_SEMAPHORE_TYPE_TIMELINE};
    VkSemaphoreCreateInfo info = {.sType = VK_STRUCTURE_TYPE_SEMAPHORE_CREATE_INFO, .pNext = &type};
    VkSemaphore semaphore;
    must(vkCreateSemaphore(device, &info, NULL, &semaphore), "making a semaphore");
    VkImportSemaphoreFdInfoKHR import_info = {.sType = VK_STRUCTURE_TYPE_IMPORT_SEMAPHORE_FD_INFO_KHR, .semaphore = semaphore,
                                              .handleType = VK_EXTERNAL_SEMAPHORE_HANDLE_TYPE_OPAQUE_FD_BIT, .fd = fd};
    PFN_vkImportSemaphoreFdKHR import_fd = (PFN_vkImportSemaphoreFdKHR)vkGetDeviceProcAddr(device, "vkImportSemaphoreFdKHR");
    must(import_fd(device, &import_info), "importing the semaphore");
    return semaphore;
}

// Copies one buffer to another that the host maps, and waits for it.
static void copy(VkBuffer from, VkBuffer to, VkDeviceSize bytes, VkSemaphore timeline, uint64_t value) {
    VkCommandBufferAllocateInfo allocation = {.sType = VK_STRUCTURE_TYPE_COMMAND_BUFFER_ALLOCATE_INFO, .commandPool = pool,
                                              .level = VK_COMMAND_BUFFER_LEVEL_PRIMARY, .commandBufferCount = 1};
    VkCommandBuffer commands;
    must(vkAllocateCommandBuffers(device, &allocation, &commands), "making a command buffer");
    VkCommandBufferBeginInfo begin = {.sType = VK_STRUCTURE_TYPE_COMMAND_BUFFER_BEGIN_INFO,
                                      .flags = VK_COMMAND_BUFFER_USAGE_ONE_TIME_SUBMIT_BIT};
    must(vkBeginCommandBuffer(commands, &begin), "recording");
    // The daemon has given the buffer away; this takes it.
    VkBufferMemoryBarrier take = {.sType = VK_STRUCTURE_TYPE_BUFFER_MEMORY_BARRIER, .dstAccessMask = VK_ACCESS_TRANSFER_READ_BIT,
                                  .srcQueueFamilyIndex = VK_QUEUE_FAMILY_EXTERNAL, .dstQueueFamilyIndex = family,
                                  .buffer = from, .size = VK_WHOLE_SIZE};
    vkCmdPipelineBarrier(commands, VK_PIPELINE_STAGE_TOP_OF_PIPE_BIT, VK_PIPELINE_STAGE_TRANSFER_BIT, 0, 0, NULL, 1, &take, 0,
                         NULL);
    VkBufferCopy region = {.size = bytes};
    vkCmdCopyBuffer(commands, from, to, 1, &region);
    VkMemoryBarrier show = {.sType = VK_STRUCTURE_TYPE_MEMORY_BARRIER, .srcAccessMask = VK_ACCESS_TRANSFER_WRITE_BIT,
                            .dstAccessMask = VK_ACCESS_HOST_READ_BIT};
    vkCmdPipelineBarrier(commands, VK_PIPELINE_STAGE_TRANSFER_BIT, VK_PIPELINE_STAGE_HOST_BIT, 0, 1, &show, 0, NULL, 0, NULL);
    must(vkEndCommandBuffer(commands), "recording");
    VkTimelineSemaphoreSubmitInfo values = {.sType = VK_STRUCTURE_TYPE_TIMELINE_SEMAPHORE_SUBMIT_INFO,
                                            .waitSemaphoreValueCount = 1, .pWaitSemaphoreValues = &value};
    VkPipelineStageFlags stages = VK_PIPELINE_STAGE_ALL_COMMANDS_BIT;
    VkSubmitInfo submit = {.sType = VK_STRUCTURE_TYPE_SUBMIT_INFO, .commandBufferCount = 1, .pCommandBuffers = &commands};
    if (timeline) {
        submit.pNext = &values;
        submit.waitSemaphoreCount = 1;
        submit.pWaitSemaphores = &timeline;
        submit.pWaitDstStageMask = &stages;
    }
    must(vkQueueSubmit(queue, 1, &submit, VK_NULL_HANDLE), "submitting");
    must(vkQueueWaitIdle(queue), "waiting");
    vkFreeCommandBuffers(device, pool, 1, &commands);
}

static VkBuffer host_buffer(VkDeviceSize bytes, void **mapped) {
    VkBufferCreateInfo info = {.sType = VK_STRUCTURE_TYPE_BUFFER_CREATE_INFO, .size = bytes,
                               .usage = VK_BUFFER_USAGE_TRANSFER_DST_BIT};
    VkBuffer buffer;
    must(vkCreateBuffer(device, &info, NULL, &buffer), "making a buffer");
    VkMemoryRequirements requirements;
    vkGetBufferMemoryRequirements(device, buffer, &requirements);
    VkPhysicalDeviceMemoryProperties types;
    vkGetPhysicalDeviceMemoryProperties(physical, &types);
    VkMemoryPropertyFlags wanted = VK_MEMORY_PROPERTY_HOST_VISIBLE_BIT | VK_MEMORY_PROPERTY_HOST_COHERENT_BIT;
    uint32_t type = 0;
    while (!(requirements.memoryTypeBits & (1u << type)) || (types.memoryTypes[type].propertyFlags & wanted) != wanted)
        if (++type == types.memoryTypeCount) die("no memory is mapped here");
    VkMemoryAllocateInfo allocation = {.sType = VK_STRUCTURE_TYPE_MEMORY_ALLOCATE_INFO, .allocationSize = requirements.size,
                                       .memoryTypeIndex = type};
    VkDeviceMemory memory;
    must(vkAllocateMemory(device, &allocation, NULL, &memory), "taking memory");
    must(vkBindBufferMemory(device, buffer, memory, 0), "binding memory");
    must(vkMapMemory(device, memory, 0, VK_WHOLE_SIZE, 0, mapped), "mapping memory");
    return buffer;
}

static void write_plane(const char *out, unsigned n, const char *kind, const char *opened, const char *plane, const char *bytes) {
    char path[4096];
    snprintf(path, sizeof path, "%s.%u.%s", out, n, kind);
    FILE *file = fopen(path, "wb");
    if (!file) die(path);
    uint64_t pitch = number(opened, plane, "row_pitch"), width = number(opened, NULL, "width");
    for (uint64_t row = 0; row < number(opened, NULL, "height"); row++)
        fwrite(bytes + number(opened, plane, "offset") + row * pitch, 4, width, file);
    if (fclose(file)) die(path);
}

int main(int argc, char **argv) {
    if (argc < 4) die("usage: import SOCKET PROJECTOR OUT [COUNT]");
    unsigned count = argc > 4 ? (unsigned)atoi(argv[4]) : 1;
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    snprintf(address.sun_path, sizeof address.sun_path, "%s", argv[1]);
    connection = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
    if (connect(connection, (struct sockaddr *)&address, sizeof address)) die("no daemon there");

    static char opened[MAX_LINE], line[MAX_LINE];
    snprintf(line, sizeof line, "{\"id\":1,\"op\":\"export.open\",\"projector\":\"%s\"}\n", argv[2]);
    say(line);
    next_line(opened);
    if (!strstr(opened, "\"ok\":")) die(opened);
    uint64_t images = number(opened, NULL, "images");
    bool has_timeline = is(value_of(opened, NULL, "semaphore"), "true");
    if (images > MAX_FDS - 1 || (uint64_t)fd_count != images + has_timeline) die("descriptors are missing");

    open_device(opened, has_timeline);
    VkBuffer buffers[MAX_FDS];
    for (uint64_t i = 0; i < images; i++) buffers[i] = import(fds[i], opened);
    VkSemaphore timeline = has_timeline ? import_timeline(fds[images]) : VK_NULL_HANDLE;
    VkDeviceSize bytes = number(opened, "buffer", "bytes");
    void *mapped;
    VkBuffer host = host_buffer(bytes, &mapped);

    for (unsigned n = 0; n < count;) {
        next_line(line);
        if (strstr(line, "\"event\":\"export_end\"")) die(line);
        if (!strstr(line, "\"event\":\"export\"")) continue;
        uint64_t image = number(line, NULL, "image");
        if (image >= images) die(line);
        copy(buffers[image], host, bytes, timeline, has_timeline ? number(line, NULL, "value") : 0);
        write_plane(argv[3], n, "rgba", opened, "color", mapped);
        write_plane(argv[3], n, "depth", opened, "depth", mapped);
        printf("picture %u %s\n", n, line);
        fflush(stdout);
        char release[128];
        snprintf(release, sizeof release, "{\"id\":2,\"op\":\"export.release\",\"image\":%u}\n", (unsigned)image);
        say(release);
        if (++n < count && !fgets(release, sizeof release, stdin)) break;
    }
    return 0;
}
