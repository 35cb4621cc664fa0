/* A Vulkan layer that fails calls of a window's swapchain: the file at SURFACE_FAULT names a call, "acquire" or
 * "present", and its next result, "outdated" or "lost", with which it is removed. */

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <vulkan/vk_layer.h>
#include <vulkan/vulkan.h>

static VkInstance created;
static PFN_vkGetInstanceProcAddr next_of_instance;
static PFN_vkGetDeviceProcAddr next_of_device;
static PFN_vkAcquireNextImageKHR next_acquire;
static PFN_vkQueuePresentKHR next_present;

/* The error to give for a call, or success. */
static VkResult fault(const char *call) {
    const char *path = getenv("SURFACE_FAULT");
    FILE *file = path == NULL ? NULL : fopen(path, "r");
    char name[16] = "", fate[16] = "";
    int read;
    if (file == NULL) return VK_SUCCESS;
    read = fscanf(file, "%15s %15s", name, fate);
    fclose(file);
    if (read != 2 || strcmp(name, call) != 0) return VK_SUCCESS;
    remove(path);
    return strcmp(fate, "lost") == 0 ? VK_ERROR_SURFACE_LOST_KHR : VK_ERROR_OUT_OF_DATE_KHR;
}

/* A failed acquisition takes no image and signals nothing. */
static VKAPI_ATTR VkResult VKAPI_CALL acquire(VkDevice device, VkSwapchainKHR swapchain, uint64_t timeout,
        VkSemaphore semaphore, VkFence fence, uint32_t *index) {
    const VkResult result = fault("acquire");
    return result != VK_SUCCESS ? result : next_acquire(device, swapchain, timeout, semaphore, fence, index);
}

/* A failed presentation waits for its semaphores all the same. */
static VKAPI_ATTR VkResult VKAPI_CALL present(VkQueue queue, const VkPresentInfoKHR *info) {
    const VkResult result = fault("present"), real = next_present(queue, info);
    return result != VK_SUCCESS ? result : real;
}

/* The link to the next layer, which is passed on in the chain of the creation. */
static VkLayerInstanceCreateInfo *link_of(const void *chain) {
    VkLayerInstanceCreateInfo *info = (VkLayerInstanceCreateInfo *)chain;
    while (info != NULL && ((info->sType != VK_STRUCTURE_TYPE_LOADER_INSTANCE_CREATE_INFO
            && info->sType != VK_STRUCTURE_TYPE_LOADER_DEVICE_CREATE_INFO) || info->function != VK_LAYER_LINK_INFO))
        info = (VkLayerInstanceCreateInfo *)info->pNext;
    return info;
}

static VKAPI_ATTR VkResult VKAPI_CALL create_instance(const VkInstanceCreateInfo *info,
        const VkAllocationCallbacks *allocator, VkInstance *instance) {
    VkLayerInstanceCreateInfo *link = link_of(info->pNext);
    PFN_vkCreateInstance create;
    VkResult result;
    if (link == NULL) return VK_ERROR_INITIALIZATION_FAILED;
    next_of_instance = link->u.pLayerInfo->pfnNextGetInstanceProcAddr;
    link->u.pLayerInfo = link->u.pLayerInfo->pNext;
    create = (PFN_vkCreateInstance)next_of_instance(NULL, "vkCreateInstance");
    result = create(info, allocator, instance);
    created = result == VK_SUCCESS ? *instance : NULL;
    return result;
}

static VKAPI_ATTR VkResult VKAPI_CALL create_device(VkPhysicalDevice physical, const VkDeviceCreateInfo *info,
        const VkAllocationCallbacks *allocator, VkDevice *device) {
    VkLayerDeviceCreateInfo *link = (VkLayerDeviceCreateInfo *)link_of(info->pNext);
    PFN_vkCreateDevice create;
    VkResult result;
    if (link == NULL) return VK_ERROR_INITIALIZATION_FAILED;
    next_of_device = link->u.pLayerInfo->pfnNextGetDeviceProcAddr;
    create = (PFN_vkCreateDevice)link->u.pLayerInfo->pfnNextGetInstanceProcAddr(created, "vkCreateDevice");
    link->u.pLayerInfo = link->u.pLayerInfo->pNext;
    result = create(physical, info, allocator, device);
    if (result == VK_SUCCESS) {
        next_acquire = (PFN_vkAcquireNextImageKHR)next_of_device(*device, "vkAcquireNextImageKHR");
        next_present = (PFN_vkQueuePresentKHR)next_of_device(*device, "vkQueuePresentKHR");
    }
    return result;
}

static VKAPI_ATTR PFN_vkVoidFunction VKAPI_CALL device_function(VkDevice device, const char *name) {
    if (strcmp(name, "vkGetDeviceProcAddr") == 0) return (PFN_vkVoidFunction)device_function;
    if (strcmp(name, "vkAcquireNextImageKHR") == 0) return (PFN_vkVoidFunction)acquire;
    if (strcmp(name, "vkQueuePresentKHR") == 0) return (PFN_vkVoidFunction)present;
    return next_of_device(device, name);
}

static VKAPI_ATTR PFN_vkVoidFunction VKAPI_CALL instance_function(VkInstance instance, const char *name) {
    if (strcmp(name, "vkGetInstanceProcAddr") == 0) return (PFN_vkVoidFunction)instance_function;
    if (strcmp(name, "vkCreateInstance") == 0) return (PFN_vkVoidFunction)create_instance;
    if (strcmp(name, "vkCreateDevice") == 0) return (PFN_vkVoidFunction)create_device;
    if (strcmp(name, "vkGetDeviceProcAddr") == 0) return (PFN_vkVoidFunction)device_function;
    return next_of_instance == NULL ? NULL : next_of_instance(instance, name);
}

VK_LAYER_EXPORT VKAPI_ATTR VkResult VKAPI_CALL vkNegotiateLoaderLayerInterfaceVersion(
        VkNegotiateLayerInterface *interface) {
    interface->loaderLayerInterfaceVersion = CURRENT_LOADER_LAYER_INTERFACE_VERSION;
    interface->pfnGetInstanceProcAddr = instance_function;
    interface->pfnGetDeviceProcAddr = device_function;
    interface->pfnGetPhysicalDeviceProcAddr = NULL;
    return VK_SUCCESS;
}
